"""Noise of a photo, from its quietest blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]

#: Second differences along both axes (Immerkaer 1996): edges and slopes vanish, white noise of 1 leaves 6.
_LAPLACIAN = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6.0
BLOCK = 16
#: The quietest share of the blocks is taken for flat; of noise alone it tells this much less than there is.
QUIET, QUIET_BIAS = 0.05, 0.83


def block_noise(plane: NDArray[np.floating]) -> tuple[Array, Array]:
    """Spread of the second differences and mean of every block of BLOCK x BLOCK px, flat [n].

    The spread is the median's, which an edge through the block moves little.
    """
    detail = ndimage.convolve(np.asarray(plane, np.float64), _LAPLACIAN, mode="nearest")
    h, w = (n // BLOCK * BLOCK for n in plane.shape)

    def blocks(v: Array) -> Array:
        return v[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).swapaxes(1, 2).reshape(-1, BLOCK * BLOCK)

    spread = 1.4826 * np.median(np.abs(blocks(detail)), axis=1)
    return spread, blocks(np.asarray(plane, np.float64)).mean(axis=1)


def noise_of(plane: NDArray[np.floating], rounding: float) -> float:
    """Standard deviation of the noise of [H, W] values in [0, 1]; at least `rounding`.

    An upper bound where a photo has fine texture everywhere; too small where the camera smoothed it away.
    """
    spread, mean = block_noise(plane)
    usable = (mean > 0.02) & (mean < 0.97)  # clipped blocks are quiet for another reason
    if usable.sum() < 8:
        return rounding
    return max(float(np.quantile(spread[usable], QUIET)) / QUIET_BIAS, rounding)
