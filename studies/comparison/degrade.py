"""Media for the mismatch study, written apart from the engine's own operator (`core.imaging`); a disc is
`core.imaging.kernel_samples.disc`.

Point spreads are [K, K] float64, odd sizes, sum 1, sampled at pixel centres.
"""

from __future__ import annotations

import io
import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.signal import fftconvolve

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8] | NDArray[np.uint16]

#: Gaussians are cut at this many standard deviations.
_CUT = 5.0


def gaussian(sigma: float) -> Array:
    """Of standard deviation `sigma` px."""
    squared = _squared(math.ceil(_CUT * sigma))
    return _normalised(np.exp(-squared / (2 * sigma**2)))


def moffat(sigma: float, beta: float = 3.0) -> Array:
    """Moffat's profile (1 + r^2 / a^2)^-beta with the full width at half maximum of a Gaussian of `sigma` px.

    What turbulent media leave: the same core, and wings that a Gaussian does not have (Moffat 1969).
    """
    width = sigma * 2 * math.sqrt(2 * math.log(2))
    a = width / (2 * math.sqrt(2 ** (1 / beta) - 1))
    return _normalised((1 + _squared(math.ceil(_CUT * sigma)) / a**2) ** -beta)


def two_gaussians(sigma: float, wide: float = 2.5, share: float = 0.15) -> Array:
    """A core of `sigma` px and a tail `wide` times as wide with `share` of the light."""
    squared = _squared(math.ceil(_CUT * sigma * wide / 1.5))
    core = _normalised(np.exp(-squared / (2 * sigma**2)))
    return (1 - share) * core + share * _normalised(np.exp(-squared / (2 * (wide * sigma) ** 2)))


def photographed(
    sharp: Pixels, kernel: Array, noise: float = 0.0, jpeg: int | None = None, seed: tuple[int, ...] = (0,)
) -> NDArray[np.uint8]:
    """A sharp photo through a medium, in 8 bits; the border (half the kernel) is to be cut afterwards.

    Args:
        sharp: [H, W, 3], sRGB-encoded; the blur acts on these values.
        kernel: the point spread.
        noise: standard deviation on encoded values in [0, 1].
        jpeg: quality (1 to 95) to compress with, or None.
        seed: of the noise.
    """
    values = sharp.astype(np.float64) / np.iinfo(sharp.dtype).max
    reach = kernel.shape[0] // 2
    padded = np.pad(values, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    blurred = fftconvolve(padded, kernel[:, :, None], mode="valid", axes=(0, 1))
    if noise > 0:
        blurred = blurred + np.random.default_rng(seed).normal(0.0, noise, blurred.shape)
    pixels = np.rint(np.clip(blurred, 0.0, 1.0) * 255).astype(np.uint8)
    if jpeg is None:
        return pixels
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=jpeg)
    with Image.open(stream) as picture:
        return np.array(picture)


def _squared(reach: int) -> Array:
    axis = np.arange(-reach, reach + 1, dtype=np.float64)
    return axis[:, None] ** 2 + axis**2


def _normalised(kernel: Array) -> Array:
    return kernel / kernel.sum()
