"""Haze from the same points at different distances: light lost on the way, and light that the way adds.

For a point of light I, seen from the distance d in the direction n (Koschmieder 1924), all differences from the
point's own mean being small:

    I - mean = mean (dg_photo - v d(r^2) - beta d(d) + p . d(n)) + b d(d) + q . d(n)

beta is the attenuation and b = beta A the backscatter, A the medium's own light. Gains, vignetting and the direction
of view are there to explain what is no haze. Directions matter most: who walks past a surface sees it from farther
away and at a flatter angle at once, and light that changes by a tenth per radian then looks like an attenuation of 0.5
either way. What all directions explain is no evidence of haze.

Errors are alike within a region of space (its gloss, what stands before it) and within a photo (its flare, its tone
curve). So the standard errors come from leaving out each region, and each photo, in turn (jackknife).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from .observations import PointObservations
from .photometry import SETTINGS as PHOTOMETRY

Array = NDArray[np.float64]

#: Columns behind the photos' gains: vignetting, attenuation, backscatter, then three directions twice.
_VIGNETTE, _ATTENUATION, _BACKSCATTER, _DIRECTIONS, _COLUMNS = 0, 1, 2, 3, 9


@dataclass(frozen=True)
class HazeFitSettings:
    """Numbers of the fit."""

    prior_direction: float = number(
        0.5,
        "relative, and linear light, per radian",
        "standard deviation of what the direction of view changes in all points alike; with 0.05 copr, which is clear,"
        " still has an optical depth of -0.26 +- 0.08",
        "0.05, 0.1, 0.2 and this on copr, banana, a rendered village and shelf, and drawn scenes 0 to 2",
        "drawn scenes 3 to 5, brighton, tea, drinks, a rendered room",
    )
    unexplained: float = number(
        0.005,
        "relative",
        "rms of a point's light that follows its distance for other reasons in all regions alike (gloss that is not"
        " linear in the direction), so that points seen from nearly one distance show no added light",
        "a rendered ball in clear air: distances that differ by 2.7 % rms, 13.5 +- 2.9 % of added light without this;"
        " drawn haze of 0.16, whose distances differ by 11 %, is found with it; no other value was tried",
        "the sets of docs/studies/effects.md",
    )


SETTINGS = HazeFitSettings()


@dataclass(frozen=True)
class HazeFit:
    """What the points say, per channel (red, green, blue).

    Attributes:
        attenuation: [3] beta, per median depth; backscatter: [3] beta A, linear light per median depth.
        attenuation_error, backscatter_error: standard errors of their means over the channels.
    """

    attenuation: Array
    backscatter: Array
    attenuation_error: float
    backscatter_error: float


@dataclass(frozen=True)
class _Normal:
    """Normal equations of one channel: of all observations, and the parts of each group that may be left out."""

    matrix: Array
    vector: Array
    parts: tuple[tuple[Array, Array], ...]


def fit_haze(observations: PointObservations) -> HazeFit:
    """The joint fit; see the module."""
    photos = len(observations.names)
    solved, regions, views = [], [], []
    for channel in range(3):
        of_regions, of_photos = _normal_equations(observations, channel)
        solved.append(_haze_of(of_regions.matrix, of_regions.vector, photos))
        regions.append(_left_out(of_regions, photos))
        views.append(_left_out(of_photos, photos))
    found = np.stack(solved)  # [3, 2]
    errors = np.hypot(*(_jackknife(np.mean(left, axis=0)) for left in (regions, views)))
    unexplained = (
        SETTINGS.unexplained * float(np.median(observations.light)) / max(_distance_spread(observations), 1e-6)
    )
    return HazeFit(found[:, 0], found[:, 1], float(errors[0]), float(np.hypot(errors[1], unexplained)))


def _distance_spread(observations: PointObservations) -> float:
    """How far the distances that a point is seen from differ, rms over all observations, median distances."""
    point, distance = observations.point, observations.distance
    mean = np.bincount(point, distance) / np.maximum(np.bincount(point), 1)
    return float(np.sqrt(np.mean((distance - mean[point]) ** 2)))


def _haze_of(matrix: Array, vector: Array, photos: int) -> Array:
    """[2] attenuation and backscatter."""
    at = photos + _ATTENUATION
    return np.asarray(np.linalg.solve(matrix, vector)[at : at + 2])


def _left_out(normal: _Normal, photos: int) -> Array:
    """[G, 2] attenuation and backscatter without each group."""
    return np.stack([_haze_of(normal.matrix - m, normal.vector - v, photos) for m, v in normal.parts])


def _jackknife(values: Array) -> Array:
    """[2] standard errors from estimates [G, 2] that leave out one group each."""
    count = len(values)
    return np.asarray(math.sqrt((count - 1) / count) * np.sqrt(((values - values.mean(axis=0)) ** 2).sum(axis=0)))


def _normal_equations(observations: PointObservations, channel: int) -> tuple[_Normal, _Normal]:
    """Of a robust least squares in one channel, with the parts of regions of space, and of photos."""
    photos = len(observations.names)
    light = observations.light[:, channel]
    weight, scale = np.ones(len(light)), PHOTOMETRY.first_scale
    prior = np.diag(_priors(photos) ** -2.0)
    for _ in range(PHOTOMETRY.rounds):
        design, target = _linearised(observations, light, weight)
        matrix = design.T @ (design * weight[:, None]) / scale**2 + prior
        rest = target - design @ np.linalg.solve(matrix, design.T @ (weight * target) / scale**2)
        scale = max(1.4826 * float(np.median(np.abs(rest))), PHOTOMETRY.least_scale)
        limit = PHOTOMETRY.outlier * scale
        weight = np.where(np.abs(rest) < limit, (1 - (rest / limit) ** 2) ** 2, 0.0)  # Tukey's biweight
    design, target = _linearised(observations, light, weight)

    def equations(group: NDArray[np.int64]) -> _Normal:
        parts = []
        for one in np.unique(group):
            rows = design[group == one]
            weighted = rows * (weight[group == one] / scale**2)[:, None]
            parts.append((weighted.T @ rows, weighted.T @ target[group == one]))
        return _Normal(sum(m for m, _ in parts) + prior, np.asarray(sum(v for _, v in parts)), tuple(parts))

    return equations(observations.block), equations(observations.photo)


def _priors(photos: int) -> Array:
    """[V + 9] standard deviations of the unknowns."""
    s = PHOTOMETRY
    others = [s.prior_vignette, s.prior_haze, 0.5 * s.prior_haze, *([SETTINGS.prior_direction] * 6)]
    return np.concatenate([np.full(photos, s.prior_gain), others])


def _linearised(observations: PointObservations, light: Array, weight: Array) -> tuple[Array, Array]:
    """Design [N, V + 9] and target [N], both about each point's own weighted mean and relative to its light."""
    point, photo, photos = observations.point, observations.photo, len(observations.names)
    total = int(point.max()) + 1
    sums = np.maximum(np.bincount(point, weight, total), 1e-12)

    def centred(values: Array) -> Array:
        return np.asarray(values - (np.bincount(point, weight * values, total) / sums)[point])

    mean = np.maximum((np.bincount(point, weight * light, total) / sums)[point], 1e-3)
    design = np.zeros((len(light), photos + _COLUMNS))
    shares = np.zeros((total, photos))
    np.add.at(shares, (point, photo), weight)
    design[:, :photos] = -(shares / sums[:, None])[point]
    design[np.arange(len(light)), photo] += 1.0
    distance = centred(observations.distance)
    design[:, photos + _VIGNETTE] = -centred(observations.radius**2)
    design[:, photos + _ATTENUATION], design[:, photos + _BACKSCATTER] = -distance, distance / mean
    for axis in range(3):
        turned = centred(observations.direction[:, axis])
        first = photos + _DIRECTIONS + 2 * axis
        design[:, first], design[:, first + 1] = turned, turned / mean
    return design, centred(light) / mean
