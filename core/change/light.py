"""Light separated from change: a gain and an offset for each photo and channel, whole and in slow fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from .settings import EVIDENCE

Floats = NDArray[np.float32]
#: Standard deviations of a normal distribution for its median absolute deviation.
_ROBUST = 1.4826
#: sRGB: differences below it are rounding; px that a gain is sought on, at most; rounds of reweighting.
_ROUNDING, _SAMPLE, _ROUNDS = 1e-4, 20_000, 10
#: sRGB^2: variance below which a render is too plain for a gain that varies.
_RIDGE = 1e-3


@dataclass(frozen=True)
class SlowLight:
    """Slowly varying gains and offsets about a render.

    Attributes:
        shown: [3, H, W] the render; weight: [H, W] how much each px counts.
        gain: of the whole photo over the render, mean of the channels.
    """

    shown: Floats
    weight: Floats
    gain: float

    def without(self, values: Floats) -> Floats:
        """[3, H, W] values less what a gain and an offset that vary slowly explain of them."""
        slow = _smoothed(self.weight)

        def mean(part: Floats) -> Floats:
            return np.asarray(_smoothed(self.weight * part) / slow)

        left = np.empty_like(values)
        for channel, (a, d) in enumerate(zip(self.shown, values, strict=True)):
            mean_a, mean_d = mean(a), mean(d)
            both, own = mean(a * d) - mean_a * mean_d, mean(a * a) - mean_a**2 + _RIDGE
            left[channel] = d - mean_d - both / own * (a - mean_a)
        return left


def _smoothed(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Three means over squares: nearly a Gaussian's, whose standard deviation is the side's half, and far faster."""
    side = 2 * round(EVIDENCE.slow) - 1
    for _ in range(3):
        values = uniform_filter(values, side)
    return np.asarray(values)


def lit_alike(shown: Floats, photo: Floats) -> tuple[Floats, SlowLight]:
    """[3, H, W] photo minus render in the render's light, and what was taken for light."""
    difference, gains = np.empty_like(shown), []
    for channel, (a, b) in enumerate(zip(shown, photo, strict=True)):
        gain, offset = _gain(a, b)
        difference[channel] = (b - offset) / gain - a
        gains.append(gain)
    light = SlowLight(shown, _weights(np.sqrt((difference**2).mean(axis=0))), float(np.mean(gains)))
    return light.without(difference), light


def _gain(a: Floats, b: Floats) -> tuple[float, float]:
    """The gain and offset of b over a, by least squares that px which differ hardly count in."""
    every = max(1, a.size // _SAMPLE)
    x, y = a.ravel()[::every].astype(np.float64), b.ravel()[::every].astype(np.float64)
    weight, gain, offset = np.ones_like(x), 1.0, 0.0
    for _ in range(_ROUNDS):
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        spread = np.average((x - mean_x) ** 2, weights=weight)
        both = np.average((x - mean_x) * (y - mean_y), weights=weight)
        gain = float(both / spread) if spread > _ROUNDING**2 and both > _ROUNDING * spread else 1.0
        offset = float(mean_y - gain * mean_x)
        rest = y - offset - gain * x
        weight = _weights(rest)
    return gain, offset


def _weights(rest: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.asarray(1 / (1 + (rest / (2 * (_ROBUST * np.median(np.abs(rest)) + _ROUNDING))) ** 2))
