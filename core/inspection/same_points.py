"""Are the same points blurrier where an effect says so? What a blur that varies does to one point in several photos.

The energy of a narrow band of frequencies around a point falls with the variance of the blur there, and with nothing
else that differs between photos but: the point's own texture (drops out within the point), the photo (a constant of
its own), and the distance (a power, as scenes' spectra are). So

    log energy = point + photo + k log depth + share R(variance that is claimed) + rest,

with R from the band and a scene whose power falls as a power of frequency. `share` is 1 where the claim is right and 0
where nothing of it is true, whatever the scene's own spectrum: an evidence of its own beside the tiles'.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..numbers import number
from .photo_set import PhotoSet
from .spectra import SETTINGS as SPECTRA

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SamePointsSettings:
    """Numbers of the comparison of points in several photos."""

    narrowest_width: float = number(0.8, "px", "first width of the band: what a Gaussian of it passes")
    shared_share: float = number(0.7, "share", "of the photos' own blur that the first width is at least")
    width_ratio: float = number(1.6, "ratio", "of the second Gaussian's width, which takes its part of the band away")
    window: float = number(3.0, "first widths", "of the Gaussian over which energy is averaged")
    minimum_energy: float = number(3.0, "noise energy", "from which energy counts")
    distance_power_spread: float = number(
        0.5, "exponent", "of the power of the distance; its mean is scenes' slope - 2"
    )
    photo_spread: float = number(1.0, "natural log", "what a photo's own constant may be")
    rounds: int = number(5, "count", "of the robust fit")
    draws: int = number(100, "count", "of regions of space for the standard error (bootstrap)")
    minimum_observations: int = number(150, "count", "for a statement")


SETTINGS = SamePointsSettings()


@dataclass(frozen=True)
class Agreement:
    """How much of what is claimed the points show: `share` of the claimed loss of energy, and its standard error."""

    share: float
    error: float


def agreement(
    photos: PhotoSet, claimed: Callable[[Array, Array], Array], floor: float, others: Callable[[Array, Array], Array]
) -> Agreement | None:
    """Compares a claim with the photos; None where too few points are seen, or the claim says the same of all.

    Args:
        claimed: (depths in the observations' unit, squared distances from the middle over half the diagonal) ->
            variances, px^2, that an effect adds there.
        floor: variance, px^2, of what blurs all px alike.
        others: of the same arguments -> [N, K] what else could differ, given the chance to explain it instead.
    """
    observations = photos.observations
    if observations is None:
        return None
    first = max(SETTINGS.narrowest_width, SETTINGS.shared_share * float(np.sqrt(max(floor, 0.0))))
    energy = _energies(photos, first)
    usable = np.isfinite(energy)
    counts = np.bincount(observations.point[usable], minlength=int(observations.point.max()) + 1)
    usable &= counts[observations.point] >= 2
    if usable.sum() < SETTINGS.minimum_observations:
        return None
    point, photo = observations.point[usable], observations.photo[usable]
    depth, radius2 = observations.depth[usable], observations.radius[usable] ** 2
    response = _response(first, max(floor, 0.0), np.maximum(claimed(depth, radius2), 0.0))
    columns = np.column_stack([response, np.log(depth), others(depth, radius2), np.eye(len(observations.names))[photo]])
    return _fitted(np.log(energy[usable]), columns, point, observations.block[usable], len(observations.names))


def _energies(photos: PhotoSet, first: float) -> Array:
    """[N] energy of the band around every observation over the square of the mean there; NaN where noise has it."""
    observations = photos.observations
    assert observations is not None
    out = np.full(len(observations), np.nan)
    for photo, grey, noise in zip(photos.looked_at, photos.greys, photos.grey_noise, strict=True):
        if photo.name not in observations.names:
            continue
        mine = np.flatnonzero(observations.photo == observations.names.index(photo.name))
        out[mine] = band_energy(grey, noise, first, observations.pixel[mine])
    return out


def band_energy(grey: NDArray[np.floating], noise: float, first: float, pixel: Array) -> Array:
    """[N] energy of a band around px [N, 2] over the square of the mean there; NaN where noise has it.

    Args:
        grey: [H, W]; noise: its standard deviation; first: width of the band's first Gaussian, px.
    """
    reach = int(np.ceil(4 * SETTINGS.width_ratio * first))
    impulse = np.zeros((2 * reach + 1,) * 2)
    impulse[reach, reach] = 1.0
    energy = ndimage.gaussian_filter(np.square(_band(grey, first)), SETTINGS.window * first, truncate=3.0)
    level = ndimage.gaussian_filter(grey, SETTINGS.window * first, truncate=3.0)
    at = pixel.T[::-1] - 0.5
    e, m = (ndimage.map_coordinates(plane, at, order=1, mode="nearest") for plane in (energy, level))
    expected = noise**2 * float(np.square(_band(impulse, first)).sum())
    e = np.where(e > (1.0 + SETTINGS.minimum_energy) * expected, e - expected, np.nan)
    return np.asarray(np.where(m > 0.01, e / np.maximum(m, 0.01) ** 2, np.nan))


def _band(grey: NDArray[np.floating], first: float) -> Array:
    low, high = (
        ndimage.gaussian_filter(np.asarray(grey, np.float32), s * first, truncate=3.5)
        for s in (SETTINGS.width_ratio, 1.0)
    )
    return np.asarray(high - low)


def _response(first: float, floor: float, variance: Array) -> Array:
    """Natural log of the share of the band's energy that a variance, px^2, beyond the floor leaves."""
    f = np.linspace(0.002, 0.5, 400)
    law = f ** (1.0 - SPECTRA.slope) * np.exp(-4 * np.pi**2 * f**2 * floor)
    band = np.exp(-2 * np.pi**2 * (f * first) ** 2) - np.exp(-2 * np.pi**2 * (f * first * SETTINGS.width_ratio) ** 2)
    at = np.linspace(0.0, max(float(variance.max()), 1e-3), 64)
    energy = (law * band**2 * np.exp(-4 * np.pi**2 * at[:, None] * f**2)).sum(axis=1)
    return np.asarray(np.interp(variance, at, np.log(energy / energy[0])))


def _fitted(
    y: Array, columns: Array, point: NDArray[np.int64], block: NDArray[np.int64], photos: int
) -> Agreement | None:
    """Robust least squares within points; the first column's factor and its error over regions of space."""
    total, count = int(point.max()) + 1, columns.shape[1]
    prior, aim = np.zeros(count), np.zeros(count)
    prior[1], aim[1] = SETTINGS.distance_power_spread**-2.0, SPECTRA.slope - 2.0
    prior[-photos:] = SETTINGS.photo_spread**-2.0
    weight, scale = np.ones(len(y)), 0.5
    design, target = columns, y
    for _ in range(SETTINGS.rounds):
        sums = np.maximum(np.bincount(point, weight, total), 1e-12)

        def centred(values: Array, w: Array = weight, s: Array = sums) -> Array:
            return values - (np.bincount(point, w * values, total) / s)[point]

        target = centred(y)
        design = np.column_stack([centred(column) for column in columns.T])
        normal = design.T @ (design * weight[:, None]) / scale**2 + np.diag(prior) + 1e-9 * np.eye(count)
        solution = np.linalg.solve(normal, design.T @ (weight * target) / scale**2 + prior * aim)
        rest = target - design @ solution
        scale = max(1.4826 * float(np.median(np.abs(rest))), 0.02)
        weight = np.where(np.abs(rest) < 4.7 * scale, (1 - (rest / (4.7 * scale)) ** 2) ** 2, 0.0)  # Tukey's biweight
    if float((weight * design[:, 0] ** 2).sum()) < 1e-3 * weight.sum():
        return None
    groups = np.unique(block)
    parts = [block == g for g in groups]
    matrices = np.stack([design[p].T @ (design[p] * weight[p, None]) for p in parts]) / scale**2
    vectors = np.stack([design[p].T @ (weight[p] * target[p]) for p in parts]) / scale**2
    random = np.random.default_rng(0)
    picks = random.multinomial(len(groups), np.full(len(groups), 1.0 / len(groups)), size=SETTINGS.draws).astype(float)
    fixed = np.diag(prior) + 1e-9 * np.eye(count)
    draws = [np.linalg.solve(np.tensordot(p, matrices, 1) + fixed, p @ vectors + prior * aim)[0] for p in picks]
    return Agreement(float(solution[0]), float(np.std(draws)))
