"""Noise of a photo, from its quietest blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..numbers import number

Array = NDArray[np.float64]

#: Second differences along both axes (Immerkaer 1996): edges and slopes vanish, white noise of 1 leaves 6.
_LAPLACIAN = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6.0
#: Side of a block, px.
BLOCK = 16


@dataclass(frozen=True)
class NoiseLevelSettings:
    """Numbers of the estimate of a photo's noise."""

    quiet: float = number(0.05, "share", "of the blocks, the quietest, that is taken for flat")
    quiet_bias: float = number(
        0.83, "ratio", "of what the quietest blocks of pure noise show to the noise", "simulated white noise"
    )
    darkest: float = number(0.02, "share of full scale", "blocks with a lower mean are clipped at black")
    brightest: float = number(0.97, "share of full scale", "blocks with a higher mean are clipped at white")
    fewest_blocks: int = number(8, "count", "usable blocks; with fewer the noise is taken for the file's rounding")


SETTINGS = NoiseLevelSettings()


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
    usable = (mean > SETTINGS.darkest) & (mean < SETTINGS.brightest)  # clipped blocks are quiet for another reason
    if usable.sum() < SETTINGS.fewest_blocks:
        return rounding
    return max(float(np.quantile(spread[usable], SETTINGS.quiet)) / SETTINGS.quiet_bias, rounding)
