"""The blur of a picture, read off its spectrum.

Scenes with edges have power that falls as a power of frequency (Field 1987), the same in all directions but for a
factor; a blur of covariance C multiplies it by the square of its transfer:

    log P(f) = a(direction) - b log |f| - 4 pi^2 f' C f,        the noise's estimated power taken off first.

The blur's term grows with f^2, the scene's does not: least squares separate them. What looks like blur but is a
scene without edges (clouds, a wall out of paint) cannot be distinguished from it by any one photo.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from ..imaging.spectral_bins import SpectralBins, polar_index
from ..numbers import number

Array = NDArray[np.float64]

#: Polar bins: radial, and directions over half a turn. The layout of `polar_power`.
RADII, DIRECTIONS = 40, 12
#: Highest frequency used, cycles/px: just below what px can hold.
HIGHEST = 0.49


@dataclass(frozen=True)
class SpectrumSettings:
    """Numbers of the fit of scene and blur to a spectrum."""

    minimum_periods: float = number(2.5, "periods", "that a tile holds at least at the lowest frequency used")
    minimum_power: float = number(3.0, "noise power", "from which a ring counts as standing clear of the noise")
    certain_power: float = number(10.0, "noise power", "where the fitted law stands so high, a bin keeps its weight")
    slope: float = number(2.3, "exponent", "of scenes' power over frequency, mean (Field 1987: about 2)")
    slope_spread: float = number(0.45, "exponent", "standard deviation of it over scenes")
    scatter: float = number(0.3, "log power", "how far power scatters around the law")
    minimum_bins: int = number(18, "count", "bins for a fit of nine unknowns")


SETTINGS = SpectrumSettings()


@dataclass(frozen=True)
class Blur:
    """A fitted blur.

    Attributes:
        covariance: [3] of the blur: xx, yy, xy, px^2; may be negative by noise.
        uncertainty: [3, 3] covariance of these three.
        slope: exponent of the scene's power.
        highest: frequency (cycles/px) up to which the picture stands clear of its noise.
    """

    covariance: Array = field(repr=False)
    uncertainty: Array = field(repr=False)
    slope: float
    highest: float

    @property
    def variance(self) -> float:
        """Mean over directions, px^2 (may be negative by noise)."""
        return float(self.covariance[0] + self.covariance[1]) / 2

    @property
    def variance_error(self) -> float:
        """Standard deviation of `variance`."""
        j = np.array([0.5, 0.5, 0.0])
        return float(np.sqrt(j @ self.uncertainty @ j))


def polar_power(values: NDArray[np.floating]) -> Array:
    """Power [RADII, DIRECTIONS] of [H, W]; white noise of variance v gives v, bins without a coefficient are 0."""
    return _bins(*values.shape).power_of(values).reshape(RADII, DIRECTIONS)


def bin_counts(h: int, w: int) -> Array:
    """[RADII, DIRECTIONS] number of coefficients in each bin of `polar_power`."""
    return _bins(h, w).counts.astype(float).reshape(RADII, DIRECTIONS)


@lru_cache(maxsize=8)
def _chance(h: int, w: int, pictures: int) -> tuple[Array, Array]:
    """What the mean of chance does to the log of a bin's power: its shift, and its variance."""
    # Neighbouring coefficients under a Hann window are not independent: about 2.25 of them say what one would.
    k = np.maximum(bin_counts(h, w) * pictures / 2.25, 0.5)
    return digamma(k) - np.log(k), polygamma(1, k)


@lru_cache(maxsize=8)
def _bins(h: int, w: int) -> SpectralBins:
    return SpectralBins((h, w), polar_index(h, w, _edges(min(h, w)), DIRECTIONS), RADII * DIRECTIONS)


def _edges(shortest: int) -> Array:
    """[RADII + 1] radial frequencies that bound the rings, cycles/px."""
    return np.geomspace(SETTINGS.minimum_periods / shortest, HIGHEST, RADII + 1)


@lru_cache(maxsize=8)
def _frequencies(shortest: int) -> tuple[Array, Array, Array]:
    """|f|, fx, fy of the bins' middles, [RADII, DIRECTIONS] each."""
    edges = _edges(shortest)
    f = np.sqrt(edges[1:] * edges[:-1])[:, None] * np.ones(DIRECTIONS)
    angle = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    return f, f * np.cos(angle), f * np.sin(angle)


def fit_blur(
    power: Array, shape: tuple[int, int], noise: float, pictures: int = 1, highest: float = HIGHEST, lowest: float = 0.0
) -> Blur | None:
    """Fits scene and blur to a polar spectrum; None where too little stands clear of the noise.

    Args:
        power: from `polar_power`, averaged over `pictures` of one size.
        shape: (height, width) of the pictures.
        noise: variance of the noise.
        lowest, highest: frequencies between which the spectrum is used, cycles/px.
    """
    f, fx, fy = _frequencies(min(shape))
    counts, (shift, variance) = bin_counts(*shape), _chance(*shape, pictures)
    radial = (power * counts).sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
    drowned = np.flatnonzero((radial < SETTINGS.minimum_power * noise) & (counts.sum(axis=1) > 0))
    end = drowned[0] if drowned.size else RADII
    clear = (counts > 0) & (power > 2.0 * noise) & (f <= highest) & (f >= lowest)
    clear[end:] = False
    if clear.sum() < SETTINGS.minimum_bins or end < 5:
        return None
    y = np.log((power - noise)[clear]) - shift[clear]
    angle = np.arctan2(fy, fx)[clear]
    columns = [
        np.ones(clear.sum()),
        *(g(n * angle) for n in (2, 4) for g in (np.cos, np.sin)),
        -np.log(f[clear]),
        *(-4 * np.pi**2 * t[clear] for t in (fx * fx, fy * fy, 2 * fx * fy)),
    ]
    matrix = np.stack(columns, axis=1)
    relative = noise / np.maximum(power - noise, 1e-30)[clear]
    weight = 1.0 / np.sqrt(variance[clear] * (1 + relative) ** 2 + SETTINGS.scatter**2)
    prior = np.zeros((5, 9))
    prior[0, 5] = 1.0 / SETTINGS.slope_spread
    prior[1:, 1:5] = np.eye(4) / 0.7  # a scene's directions differ by a factor of two, seldom more
    aim = np.zeros(5)
    aim[0] = SETTINGS.slope / SETTINGS.slope_spread
    for _ in range(4):
        a = np.vstack([matrix * weight[:, None], prior])
        b = np.append(y * weight, aim)
        normal = a.T @ a
        solution = np.linalg.solve(normal, a.T @ b)
        law = matrix @ solution
        rest = np.abs(y - law) * weight
        weight = weight * np.sqrt(np.minimum(1.0, 2.5 / np.maximum(rest, 1e-9)))
        # Bins that chance lifted above the noise would straighten the curve: the law decides which ones count.
        weight = weight * (np.exp(law) > SETTINGS.certain_power * noise)
        if np.count_nonzero(weight) < SETTINGS.minimum_bins:
            return None
    # Rings scatter together (the scene's own bumps): as many independent values as rings, not as bins.
    inflate = clear.sum() / max(1.0, float(clear.any(axis=1).sum()))
    uncertainty = np.linalg.inv(normal)[6:, 6:] * min(inflate, 6.0)
    return Blur(_without_leakage(solution[6:], shape), uncertainty, float(solution[5]), float(f[end - 1, 0]))


def _without_leakage(seen: Array, shape: tuple[int, int]) -> Array:
    """[3] covariance xx, yy, xy of the blur, given that of the spectrum's curve.

    The window mixes neighbouring frequencies, with a variance D of 1 / 3 N^2 along a side of N px (Hann). A spectrum
    that falls as exp(-4 pi^2 f' C f) gains 32 pi^4 f' C D C f in log power by that: it looks like C - 8 pi^2 C D C.
    """
    xx, yy, xy = seen
    apparent = np.array([[xx, xy], [xy, yy]])
    mixing = 8.0 * np.pi**2 / 3.0 * np.diag([1.0 / shape[1] ** 2, 1.0 / shape[0] ** 2])
    true = apparent
    for _ in range(4):
        true = apparent + true @ mixing @ true
    return np.array([true[0, 0], true[1, 1], true[0, 1]])


def middle_frequencies(shortest: int) -> Array:
    """[RADII] frequencies of the rings' middles, cycles/px, of pictures whose shorter side is `shortest` px."""
    return _frequencies(shortest)[0][:, 0].copy()
