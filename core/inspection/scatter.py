"""How far values scatter beyond what their own noise explains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..numbers import number

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class ScatterSettings:
    """Numbers of `scatter_of`."""

    least_error: float = number(0.003, "relative", "of a scatter of gains: no set of photos says more")


SETTINGS = ScatterSettings()


def scatter_of(values: np.ndarray, draws: np.ndarray) -> tuple[float, float]:
    """Standard deviation of `values` [V, ...] without what noise adds, and its own error.

    Args:
        draws: [D, V, ...] bootstrap draws of `values`.
    """
    noise = float(draws.var(axis=0).mean())
    total = float(values.var())
    value = math.sqrt(max(total - noise, 0.0))
    count = max(2, values.shape[0])
    error = math.sqrt(total / (2 * (count - 1)) + noise / count)
    return value, max(error, SETTINGS.least_error)
