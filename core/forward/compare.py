"""How far predicted photos are from those that were taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Planes = TypeVar("Planes", Tensor, NDArray[Any])

#: Mean squared errors below this count as this one: 100 dB, far beyond what a photo of 16 bits can say.
MINIMUM_ERROR = 1e-10


def mask_of(valid: NDArray[np.bool_] | None) -> Tensor | None:
    """[H, W] bool: which px count, as a tensor; None for all."""
    return None if valid is None else torch.from_numpy(valid)


def counted(planes: Planes, valid: Planes | None) -> Planes:
    """The values [3, K] or [3, H, W] of those px that count."""
    return planes if valid is None else planes[:, valid]


def mean_square(residual: Planes, valid: Planes | None = None) -> float:
    """Mean square of a residual [3, H, W] over the px that count ([H, W] bool)."""
    return float(counted(residual**2, valid).mean())


def psnr_of(errors: Sequence[float]) -> float:
    """PSNR in dB of photos in [0, 1], from their mean squared errors."""
    return -10.0 * math.log10(max(sum(errors) / len(errors), MINIMUM_ERROR))
