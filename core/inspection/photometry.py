"""Gains and vignetting, with what haze could do beside, from the colours of the same points in several photos.

For a point seen in several photos, with light I, gain g of the photo, distance r from its middle and depth d,
all differences from the point's own mean being small:

    I - mean = mean (dg_photo - v d(r^2)) - beta mean d(d) + beta A d(d)

The point's own colour drops out. All unknowns are linear: one robust least squares per channel. What two effects
could both explain shows in the uncertainty of both, which comes from drawing regions of space again and again. (Haze
itself is asked about by `haze_fit`, which has directions of view besides.)
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from .observations import PointObservations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PhotometrySettings:
    """Numbers of the joint fit of gains, vignetting and haze."""

    rounds: int = number(6, "count", "rounds of reweighting")
    draws: int = number(200, "count", "draws of regions of space (bootstrap), for the uncertainty")
    prior_gain: float = number(
        0.5, "natural log", "standard deviation of a photo's gain, so that what is unseen stays finite"
    )
    prior_vignette: float = number(0.7, "share", "the same of the light lost in the corner")
    prior_haze: float = number(1.0, "1 / median depth", "the same of the attenuation; the backscatter's is half of it")
    outlier: float = number(4.7, "robust sigmas", "residuals beyond do not count", "Tukey's usual 95 % efficiency")
    first_scale: float = number(0.05, "relative", "scatter that the fit begins with")
    least_light: float = number(1e-4, "linear light", "whose logarithm is taken: darker is noise")
    fewest_of_photo: int = number(5, "observations", "of a photo that say anything of its gain alone")
    photos_asked: float = number(
        0.5,
        "share",
        "of the photos that have so many in both halves of space; with fewer, what two halves agree on says nothing",
        "judgement, after a polished orrery of 48 photos and 254 observations; no other value was tried",
    )
    least_scale: float = number(0.003, "relative", "scatter at least, so that no perfect fit divides by zero")


SETTINGS = PhotometrySettings()


@dataclass(frozen=True)
class Photometry:
    """What the observations say, per channel (red, green, blue), with draws for its uncertainty.

    Attributes:
        gains: [V, 3] natural log of each photo's gain, mean 0 over the photos.
        vignette: [3] share of light lost where r = 1 (the corner).
        gains_draws, vignette_draws: the same with a first axis of draws.
        residual: [N, 3] what is left, relative to the point's mean; weight: [N, 3] in [0, 1].
        spread: robust standard deviation of the residuals.
    """

    gains: Array = field(repr=False)
    vignette: Array
    gains_draws: Array = field(repr=False)
    vignette_draws: Array = field(repr=False)
    residual: Array = field(repr=False)
    weight: Array = field(repr=False)
    spread: float = 0.0


def fit_photometry(observations: PointObservations, seed: int = 0) -> Photometry:
    """The joint fit; see the module."""
    photos = len(observations.names)
    blocks = int(observations.block.max()) + 1
    picks = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SETTINGS.draws)
    found, drawn, residuals, weights = [], [], [], []
    for channel in range(3):
        solution, draws, residual, weight = _fit(observations, channel, photos, blocks, picks)
        found.append(solution)
        drawn.append(draws)
        residuals.append(residual)
        weights.append(weight)
    s, d = np.stack(found), np.stack(drawn, axis=1)  # [3, K], [draws, 3, K]
    gains = s[:, :photos].T
    gains_draws = d[:, :, :photos].transpose(0, 2, 1)
    residual_all, weight_all = np.stack(residuals, 1), np.stack(weights, 1)
    return Photometry(
        gains - gains.mean(axis=0),
        s[:, photos],
        gains_draws - gains_draws.mean(axis=1, keepdims=True),
        d[:, :, photos],
        residual_all,
        weight_all,
        1.4826 * float(np.median(np.abs(residual_all))),
    )


def explained_elsewhere(observations: PointObservations) -> float:
    """Share of what differs between photos of the same points that gains explain which other regions of space gave.

    An exposure moves all points of a photo alike, wherever they are. Gloss, shadows and points that hide each other
    move those of one region, and the photo's mean along with them: elsewhere such gains explain nothing.

    Returns:
        Of the variance of the light's logarithm about each point's own mean, by its median; the mean of both halves of
        the regions explained by the other. At most 1, negative where gains add to what differs; 0 where too few photos
        have observations enough to tell.
    """
    even = observations.block % 2 == 0
    counts = [np.bincount(observations.photo[half], minlength=len(observations.names)) for half in (even, ~even)]
    if float((np.minimum(*counts) >= SETTINGS.fewest_of_photo).mean()) < SETTINGS.photos_asked:
        return 0.0
    light = np.log(np.maximum(observations.light, SETTINGS.least_light))
    before = np.abs(_about_own_mean(light, observations.point))
    shares = []
    for giving, judged in ((even, ~even), (~even, even)):
        if not giving.any() or not judged.any():
            continue
        gains = _gains_alone(light, observations, giving)
        after = np.abs(_about_own_mean(light - gains[observations.photo], observations.point))
        spread = float(np.median(before[judged]))
        shares.append(1.0 - (float(np.median(after[judged])) / spread) ** 2 if spread > 0 else 0.0)
    return float(np.mean(shares)) if shares else 0.0


def _gains_alone(light: Array, observations: PointObservations, chosen: NDArray[np.bool_]) -> Array:
    """[V, 3] natural log of each photo's gain by the chosen observations, medians of what is left taken in turns."""
    gains = np.zeros((len(observations.names), light.shape[1]))
    for _ in range(SETTINGS.rounds):
        rest = _about_own_mean(light - gains[observations.photo], observations.point)
        for photo in range(len(gains)):
            mine = chosen & (observations.photo == photo)
            if mine.sum() >= SETTINGS.fewest_of_photo:
                gains[photo] += np.median(rest[mine], axis=0)
        gains -= gains.mean(axis=0)
    return gains


def _about_own_mean(values: Array, point: NDArray[np.int64]) -> Array:
    """[N, 3] less the mean of each point's own values."""
    count = np.maximum(np.bincount(point), 1)
    mean = np.stack([np.bincount(point, values[:, channel]) / count for channel in range(values.shape[1])], axis=1)
    return np.asarray(values - mean[point])


def _fit(
    observations: PointObservations, channel: int, photos: int, blocks: int, picks: NDArray[np.int64]
) -> tuple[Array, Array, Array, Array]:
    point, photo = observations.point, observations.photo
    light = observations.light[:, channel]
    total = int(point.max()) + 1
    weight = np.ones(len(light))
    others = [SETTINGS.prior_vignette, SETTINGS.prior_haze, 0.5 * SETTINGS.prior_haze]
    prior = np.concatenate([np.full(photos, SETTINGS.prior_gain), others]) ** -2.0
    solution = np.zeros(photos + 3)
    design, target = np.zeros((len(light), photos + 3)), np.zeros(len(light))
    scale = SETTINGS.first_scale
    for _ in range(SETTINGS.rounds):
        sums = np.maximum(np.bincount(point, weight, total), 1e-12)

        def centred(values: Array, w: Array = weight, s: Array = sums) -> Array:
            return values - (np.bincount(point, w * values, total) / s)[point]

        mean = np.maximum((np.bincount(point, weight * light, total) / sums)[point], 1e-3)
        target = centred(light) / mean
        design = np.zeros((len(light), photos + 3))
        indicator = np.zeros((len(light), photos))
        indicator[np.arange(len(light)), photo] = 1.0
        shares = np.zeros((total, photos))
        np.add.at(shares, (point, photo), weight)
        design[:, :photos] = indicator - (shares / sums[:, None])[point]
        design[:, photos] = -centred(observations.radius**2)
        depth = centred(observations.depth)
        design[:, photos + 1], design[:, photos + 2] = -depth, depth / mean
        normal = design.T @ (design * weight[:, None]) / scale**2 + np.diag(prior)
        solution = np.linalg.solve(normal, design.T @ (weight * target) / scale**2)
        rest = target - design @ solution
        scale = max(1.4826 * float(np.median(np.abs(rest))), SETTINGS.least_scale)
        limit = SETTINGS.outlier * scale
        weight = np.where(np.abs(rest) < limit, (1 - (rest / limit) ** 2) ** 2, 0.0)  # Tukey's biweight
    matrices = np.zeros((blocks, photos + 3, photos + 3))
    vectors = np.zeros((blocks, photos + 3))
    for block in range(blocks):
        inside = observations.block == block
        part = design[inside]
        matrices[block] = part.T @ (part * weight[inside, None]) / scale**2
        vectors[block] = part.T @ (weight[inside] * target[inside]) / scale**2
    draws = np.stack(
        [np.linalg.solve(np.tensordot(p, matrices, 1) + np.diag(prior), p @ vectors) for p in picks.astype(float)]
    )
    return solution, draws, target - design @ solution, weight
