"""Arrays of light per px: moments, resampling, trimming, convolution. What a point spread's samples are worked with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Samples along a side of a px that a disc's rim crosses; the area is then right to less than a percent.
_DISC_SAMPLES = 16
#: Radius (px) below which a disc is a point.
_SMALLEST_DISC = 0.1


def moments(samples: Array) -> tuple[Array, Array]:
    """Centroid [2] (x, y; px from the middle of the array) and covariance [2, 2] (px^2)."""
    rows, columns = samples.shape
    weight = samples / samples.sum()
    x, y = np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2
    centroid = np.array([(weight.sum(axis=0) * x).sum(), (weight.sum(axis=1) * y).sum()])
    dx, dy = x - centroid[0], y - centroid[1]
    xy = dy @ weight @ dx
    variances = (weight.sum(axis=0) * dx * dx).sum(), (weight.sum(axis=1) * dy * dy).sum()
    return centroid, np.array([[variances[0], xy], [xy, variances[1]]])


def interpolation(size: int, s: float, offset: float = 0.0, linear: bool = False) -> Array:
    """[odd, size]: resamples taps to a grid `s` times coarser whose middle is at `offset` from theirs.

    Every tap's light is spread over the coarse taps around it, by Keys' cubic convolution, which
    keeps sum, centroid and variance (the linear hat keeps the first two and never undershoots).
    """
    position = (np.arange(size) - (size - 1) / 2 - offset) / s
    radius = math.ceil(abs(position).max() + (1 if linear else 2)) - 1
    return spreading(np.abs(np.arange(-radius, radius + 1)[:, None] - position[None, :]), linear)


def spreading(t: Array, linear: bool = False) -> Array:
    """Share of a point's light that a px at a distance of `t` px takes: see `interpolation`."""
    if linear:
        return np.asarray(np.maximum(0.0, 1.0 - t))
    near, far = (1.5 * t - 2.5) * t * t + 1.0, ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0
    return np.where(t <= 1, near, np.where(t < 2, far, 0.0))


def trimmed(samples: Array) -> Array:
    """Without borders that hold less than 1e-6 of the light in all; the centre stays."""
    for _ in range(2):
        rows = samples.sum(axis=1)
        cut = 0
        while cut < samples.shape[0] // 2 and rows[: cut + 1].sum() + rows[-cut - 1 :].sum() < 5e-7:
            cut += 1
        samples = samples[cut : samples.shape[0] - cut].T
    return np.ascontiguousarray(samples / samples.sum())


def convolved_samples(a: Array, b: Array) -> Array:
    """[K + M - 1, L + N - 1] full convolution of [K, L] and [M, N]."""
    size = a.shape[0] + b.shape[0] - 1, a.shape[1] + b.shape[1] - 1
    if b.size > 64:
        return np.fft.irfft2(np.fft.rfft2(a, size) * np.fft.rfft2(b, size), size)
    out = np.zeros(size)
    for (i, j), value in np.ndenumerate(b):
        out[i : i + a.shape[0], j : j + a.shape[1]] += value * a
    return out


def disc(radius: float) -> Array:
    """[K, K] a uniform disc of `radius` px, of sum 1, its rim by the area that it covers: a lens out of focus."""
    if radius <= _SMALLEST_DISC:
        return np.ones((1, 1))
    reach = math.ceil(radius)
    side = (2 * reach + 1) * _DISC_SAMPLES
    place = (np.arange(side) + 0.5) / _DISC_SAMPLES - reach - 0.5
    covered = (place[:, None] ** 2 + place**2 <= radius**2).astype(np.float64)
    kernel = covered.reshape(2 * reach + 1, _DISC_SAMPLES, 2 * reach + 1, _DISC_SAMPLES).mean(axis=(1, 3))
    return np.asarray(kernel / kernel.sum())
