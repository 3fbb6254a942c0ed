"""sRGB and linear light, the one place that has the curve (IEC 61966-2-1).

Outside [0, 1] both curves go on monotonically: linearly below 0 (the curve's own first segment)
and by the same power above 1. Slopes are finite everywhere. Arrays need numpy only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

Values = TypeVar("Values", "Tensor", NDArray[np.float32], NDArray[np.float64])

#: Where the curve's straight segment ends, as a display value and in linear light (the standard's).
_SRGB_KNEE, _LINEAR_KNEE = 0.04045, 0.0031308
#: Slope of the straight segment, and offset and exponent of the power above it (the standard's).
_SLOPE, _OFFSET, _POWER = 12.92, 0.055, 2.4
#: The same for compiled kernels: knee (a display value), slope, offset and power of the curve to linear light.
DECODING = _SRGB_KNEE, _SLOPE, _OFFSET, _POWER


def srgb_to_linear(srgb: Values) -> Values:
    """Display values to linear light, elementwise, of the same type and dtype; differentiable in torch."""
    if not isinstance(srgb, np.ndarray):
        import torch  # heavy: torch

        # The power's branch is fed a harmless value where it is not used: NaN times 0 is NaN.
        safe = srgb.clamp(min=_SRGB_KNEE)
        curved = ((safe + _OFFSET) / (1 + _OFFSET)) ** _POWER
        return torch.where(srgb > _SRGB_KNEE, curved, srgb / _SLOPE)
    curved_array = ((np.maximum(srgb, _SRGB_KNEE) + _OFFSET) / (1 + _OFFSET)) ** _POWER
    return cast(Values, np.where(srgb > _SRGB_KNEE, curved_array, srgb / _SLOPE))


def linear_to_srgb(linear: Values) -> Values:
    """Linear light to display values, elementwise, of the same type and dtype; differentiable in torch."""
    if not isinstance(linear, np.ndarray):
        import torch  # heavy: torch

        safe = linear.clamp(min=_LINEAR_KNEE)
        curved = (1 + _OFFSET) * safe ** (1 / _POWER) - _OFFSET
        return torch.where(linear > _LINEAR_KNEE, curved, linear * _SLOPE)
    curved_array = (1 + _OFFSET) * np.maximum(linear, _LINEAR_KNEE) ** (1 / _POWER) - _OFFSET
    return cast(Values, np.where(linear > _LINEAR_KNEE, curved_array, linear * _SLOPE))


def decoding_derivative(srgb: Tensor, linear: Tensor) -> Tensor:
    """Derivative of `srgb_to_linear` at `srgb`, whose value there, `linear`, is given: no power is taken again."""
    import torch  # heavy: torch

    return torch.where(srgb > _SRGB_KNEE, _POWER * linear / (srgb + _OFFSET), 1.0 / _SLOPE)


def encoding_derivative(linear: Tensor, srgb: Tensor) -> Tensor:
    """Derivative of `linear_to_srgb` at `linear`, whose value there, `srgb`, is given: no power is taken again."""
    import torch  # heavy: torch

    return torch.where(linear > _LINEAR_KNEE, (srgb + _OFFSET) / (_POWER * linear), _SLOPE)
