"""Each photo's focus and the aperture that all share, from the same points in different photos.

A point's texture is the same from wherever it is seen. So the energy of a band of frequencies around it differs between
photos by the blur there (`same_points`), and the blur of a lens by the depth of the point and the photo's focus alone:

    log energy = point + photo + common(depth) + R(strength |1 / depth - focus|) + rest,

with `common` what all photos share (a scene's power of the distance, haze: a parabola in log depth) and R what a disk
of that standard deviation leaves of the band. Several bands: a fine one shows small circles and drowns in noise behind
large ones, which coarse ones measure. No twin takes part, and no photo has to be sharp: what is found says where the
learning of foci begins, before a twin of blurred photos has become as soft as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from ..numbers import NOT_CHECKED, number
from ..photos.load import Photo
from .noise_level import noise_of
from .photo_set import PhotoSet, grey_of
from .same_points import SETTINGS as BANDS
from .same_points import band_energy
from .spectra import SETTINGS as SPECTRA

Array = NDArray[np.float64]

#: What most of the numbers below rest on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class FocusByPointsSettings:
    """Numbers of the foci that points show."""

    widths: tuple[float, ...] = number(
        (1.0, 2.0, 4.0), "times the narrowest that `same_points` takes", "first widths of the bands", _FIRST
    )
    side: int = number(
        400, "px", "shorter side that photos are averaged down to at least: a circle is as large as they are", _FIRST
    )
    spread: float = number(0.6, "natural log", "of what is left; more counts as its logarithm (Cauchy)", _FIRST)
    photo_spread: float = number(0.5, "natural log", "what a photo's own constant in a band may be", _FIRST)
    depth_spread: float = number(
        0.5, "natural log", "for each unit of log depth and of its square: what all photos share", _FIRST
    )
    least: float = number(0.3, "px", "standard deviation over a photo's range of 1 / depth that is tried", _FIRST)
    most: float = number(12.0, "px", "the same, at most", _FIRST)
    strengths: int = number(17, "count", "between which the best is looked for, evenly in their logarithm", _FIRST)
    first_apart: int = number(4, "strengths", "of which one is tried first, then those beside the best", _FIRST)
    foci: int = number(61, "count", "that are tried of each photo, evenly in 1 / depth", _FIRST)
    beyond: float = number(1.0, "of a photo's range of 1 / depth", "from its middle that a focus may lie", _FIRST)
    rounds: int = number(25, "count", "of points, photos and foci in turn", _FIRST)
    sharp: float = number(
        5.0, "natural log of the likelihood", "that a photo must gain by a focus, or it counts as sharp", _FIRST
    )
    of_photo: int = number(20, "count", "observations of a photo, or its focus is not said", _FIRST)
    photos: int = number(5, "count", "whose foci are said at least, or nothing is", _FIRST)
    clear: float = number(
        0.03,
        "natural log of the likelihood, for each observation",
        "that foci must explain, so that they are tried",
        "photos through a lens 0.28 (banana), 0.38 (copr), 0.42 (shelf), drinks 0.21; sharp, shaken, hazy and evenly"
        " blurred ones, seventeen sets, at most 0.011; a drawn one that is blurrier towards its corners 0.023",
        "brighton through a lens 0.36, a room from inside 0.014 (missed); twenty sharp rendered sets at most 0.010, but"
        " for one plant, 0.040, where a trial refuses it",
    )
    certain: float = number(
        0.1,
        "natural log of the likelihood, for each observation",
        "the same, beyond which only a focus that moves explains it, and no trial is made",
        "the same sets",
        "the same sets: brighton alone is beyond it",
    )
    certain_share: float = number(
        0.5,
        "of all photos",
        "whose foci are said, where points show it beyond doubt",
        "judgement, after sharp photos of banana, where 7 of 16 photos have points enough",
        NOT_CHECKED,
    )


SETTINGS = FocusByPointsSettings()

#: Standard deviations (px) of the disks whose spectra are tabled; wider ones leave as little as the widest.
_DISKS = np.linspace(0.0, SETTINGS.most, 240)


@dataclass(frozen=True)
class FociOfPoints:
    """What points show of the photos' foci.

    Attributes:
        strength: share of a photo's diagonal that sigma grows by for each 1 / depth off the focus.
        foci: 1 / depth in focus, by photo; depths in `unit`, the cameras' units of length.
        sharp: photos that no blur of that strength explains better than none.
        gain: natural log of the likelihood, for each observation, over photos without any focus, or that each moved.
        unit: see `foci`; share: of all photos, that foci are said of.
        width: standard deviation (px of a photo) of the blur half a photo's range of 1 / depth off the focus.
    """

    strength: float
    foci: Mapping[str, float]
    sharp: frozenset[str]
    gain: float
    unit: float
    share: float
    width: float

    @property
    def clear(self) -> bool:
        """Whether a focus that moves is worth a trial."""
        return self.gain > SETTINGS.clear

    @property
    def certain(self) -> bool:
        """Whether points show it without a trial."""
        return self.gain > SETTINGS.certain and self.share >= SETTINGS.certain_share


def focus_by_points(photos: PhotoSet) -> FociOfPoints | None:
    """Foci of all photos that points are seen in; None where too few are.

    Deterministic; a few seconds for 30 photos.
    """
    seen = _seen(photos)
    if seen is None:
        return None
    none, shaken, found = _Fit(seen, []), _Fit(seen, _shaken(seen)), _best(seen)
    fit, foci = found.fit, _foci(seen)[np.arange(len(seen.names)), found.fit.chosen]
    return FociOfPoints(
        found.strength / seen.diagonal,
        {seen.names[v]: float(foci[v]) for v in seen.counted},
        frozenset(seen.names[v] for v in seen.counted if fit.sharp[v]),
        max(0.0, min(none.cost, shaken.cost) - fit.cost) / seen.observations,
        seen.unit,
        len(seen.counted) / seen.photos,
        0.5 * found.strength * seen.range * seen.step,
    )


@dataclass(frozen=True)
class _WithStrength:
    """A fit of foci with one strength, px for each 1 / depth."""

    strength: float
    fit: _Fit

    @staticmethod
    def of(seen: _Seen, strength: float) -> _WithStrength:
        """The best foci."""
        foci = _foci(seen)
        off = (np.abs(seen.inverse[row][:, None] - foci[v]) for v, row in enumerate(seen.of_photo))
        return _WithStrength(strength, _Fit(seen, [strength * some for some in off]))


def _foci(seen: _Seen) -> Array:
    """[V, F] 1 / depth that are tried of each photo."""
    reach = SETTINGS.beyond * seen.range
    return np.asarray(seen.middles[:, None] + np.linspace(-reach, reach, SETTINGS.foci))


def _shaken(seen: _Seen) -> list[Array]:
    """What a camera that moved in each photo, as far as it may have, blurs points by: in proportion to 1 / depth."""
    widths = np.geomspace(SETTINGS.least, SETTINGS.most, SETTINGS.foci)
    return [seen.inverse[row][:, None] * widths for row in seen.of_photo]


def _best(seen: _Seen) -> _WithStrength:
    """With the strength that explains most: of a few first, then of those beside the best."""
    tried = np.geomspace(SETTINGS.least, SETTINGS.most, SETTINGS.strengths) / seen.range
    fits: dict[int, _WithStrength] = {}

    def best_of(places: Iterable[int]) -> int:
        for at in places:
            if 0 <= at < len(tried) and at not in fits:
                fits[at] = _WithStrength.of(seen, float(tried[at]))
        return min(fits, key=lambda at: fits[at].fit.cost)

    apart = SETTINGS.first_apart
    best = best_of(range(0, len(tried), apart))
    while apart > 1:
        apart //= 2
        best = best_of((best - apart, best + apart))
    around = [at for at in (best - 1, best, best + 1) if at in fits]
    middle = math.log(tried[best])
    strength = _vertex(np.log(tried[around]), np.array([fits[at].fit.cost for at in around]), middle)
    return min(_WithStrength.of(seen, math.exp(strength)), fits[best], key=lambda each: each.fit.cost)


def _vertex(at: Array, cost: Array, middle: float) -> float:
    """Where the parabola through three places is lowest; the middle one where there are fewer."""
    if len(at) < 3:
        return middle
    second, first, _ = np.polyfit(at - middle, cost, 2)
    return middle if second <= 0 else middle + float(np.clip(-first / (2 * second), at[0] - middle, at[-1] - middle))


@dataclass(frozen=True)
class _Seen:
    """Logarithms of energies, of all bands one after the other.

    Attributes:
        log_energy: [N], a scene's power of the distance taken off; inverse: [N] 1 / depth.
        point, photo: [N] a point, a photo, in one of the bands each; band: [N] which band.
        of_photo: rows of each photo; counted: photos that have enough of them.
        middles: [V] of a photo's 1 / depth; range: of a photo's 1 / depth.
        observations: so many, whatever the bands; photos: so many, seen or not; diagonal: of a photo, px as looked at;
            step: photo px of one of those; unit: of depth.
        left: [B, T] natural log of what disks of T standard deviations (`_DISKS`) leave of a band's energy.
    """

    log_energy: NDArray[np.float32] = field(repr=False)
    inverse: Array = field(repr=False)
    point: NDArray[np.int64] = field(repr=False)
    photo: NDArray[np.int64] = field(repr=False)
    band: NDArray[np.int64] = field(repr=False)
    of_photo: list[NDArray[np.int64]] = field(repr=False)
    counted: list[int]
    middles: Array
    range: float
    names: tuple[str, ...]
    observations: int
    photos: int
    diagonal: float
    step: int
    unit: float
    left: Array = field(repr=False)


def _seen(photos: PhotoSet) -> _Seen | None:
    observed = photos.rough_observations
    if observed is None:
        return None
    step = max(1, min(min(photo.size) for photo in photos.photos) // SETTINGS.side)
    sigma = photos.sharpest / step
    widths = np.array(SETTINGS.widths) * max(BANDS.narrowest_width, BANDS.shared_share * sigma)
    by_name = {photo.name: photo for photo in photos.photos}
    pixels = [observed.pixel[observed.photo == v] / step for v in range(len(observed.names))]

    def energies(photo: Photo, at: Array) -> Array:
        grey = _coarse(grey_of(photo, photos.linear), step)
        noise = noise_of(grey, photos.rounding / 3.0**0.5 / step)
        return np.stack([band_energy(grey, noise, width, at) for width in widths])

    energy = np.full((len(SETTINGS.widths), len(observed)), np.nan)
    for v, found in enumerate(photos.of_each(energies, [by_name[name] for name in observed.names], pixels)):
        energy[:, observed.photo == v] = found
    points = int(observed.point.max()) + 1
    usable = np.isfinite(energy)
    often = np.stack([np.bincount(observed.point[row], minlength=points) >= 2 for row in usable])
    band, at = np.nonzero(usable & often[:, observed.point])
    photo, inverse = observed.photo[at], 1.0 / observed.depth[at]
    rows = [np.flatnonzero(photo == v) for v in range(len(observed.names))]
    counted = [v for v, row in enumerate(rows) if len(row) >= SETTINGS.of_photo * len(SETTINGS.widths)]
    if len(counted) < SETTINGS.photos:
        return None
    ends = np.array([np.quantile(inverse[row], [0.03, 0.97]) if len(row) else (1.0, 1.0) for row in rows])
    spread = max(float(np.median(ends[counted, 1] - ends[counted, 0])), 1e-3)
    target = np.log(energy[band, at]) + (SPECTRA.slope - 2.0) * np.log(inverse)
    _, point = np.unique(observed.point[at] + points * band, return_inverse=True)
    height, width = (side // step for side in photos.photos[0].size)
    in_band = photo + len(rows) * band
    diagonal = math.hypot(height, width)
    middles = ends.mean(axis=1)
    kept = target.astype(np.float32), inverse, point, in_band, band, rows, counted, middles, spread
    left = np.stack([_left(float(width), sigma) for width in widths])
    counts = len(observed), len(photos.photos)
    return _Seen(*kept, observed.names, *counts, diagonal, step, observed.median_depth, left)


def _coarse(grey: NDArray[np.floating], step: int) -> NDArray[np.floating]:
    """Means of `step` x `step` px."""
    height, width = (side // step for side in grey.shape)
    return np.asarray(grey[: height * step, : width * step].reshape(height, step, width, step).mean(axis=(1, 3)))


class _Fit:
    """Which of its blurs explains each photo best: points, photos and blurs in turn, robustly.

    Args:
        sigmas: for each photo [n, F] px, by what it may be blurred where its points are; empty: none is blurred.

    Attributes:
        cost: less natural log of the likelihood; chosen: [V] which of a photo's blurs; sharp: [V] whether none explains
            more.
    """

    def __init__(self, seen: _Seen, sigmas: Sequence[Array]) -> None:
        s, count = SETTINGS, len(seen.names)
        self._seen = seen
        self._responses = [
            _responses(some, seen.band[row], seen.left) for row, some in zip(seen.of_photo, sigmas, strict=False)
        ]
        # A point is as sharp as the photo that shows it best.
        self._texture = np.full(int(seen.point.max()) + 1, -np.inf)
        np.maximum.at(self._texture, seen.point, seen.log_energy)
        self._photo, self._blurred = np.zeros(count * len(s.widths)), np.zeros_like(seen.log_energy)
        log_depth = -np.log(seen.inverse)
        self._common = np.zeros_like(seen.log_energy)
        self._of_depth = [
            (rows, np.column_stack([log_depth[rows], log_depth[rows] ** 2]))
            for rows in (np.flatnonzero(seen.band == index) for index in range(len(s.widths)))
        ]
        self.chosen, self.sharp = np.full(count, -1), np.zeros(count, bool)
        for turn in range(s.rounds):
            before, ripe = self.chosen.copy(), turn > s.rounds // 3  # (before, any photo may still look sharp)
            self._find_foci(ripe)
            self._find_constants()
            if ripe and (before == self.chosen).all():
                break
        left = self._left_of(self._texture[seen.point] + self._photo[seen.photo])
        self.cost = float(_cost(left).sum()) + _held(self._photo)

    def _left_of(self, known: Array) -> Array:
        """[N] what blur, what all photos share of the depth and something else leave."""
        return np.asarray(self._seen.log_energy - known - self._common - self._blurred)

    def _find_foci(self, ripe: bool) -> None:
        """Of all photos, points' textures and photos' constants as they are; `ripe`: a photo may be a sharp one."""
        seen = self._seen
        known = self._texture[seen.point] + self._photo[seen.photo] + self._common
        rest = (seen.log_energy - known).astype(np.float32)
        for v, responses in enumerate(self._responses):
            row = seen.of_photo[v]
            costs = _cost(rest[row][:, None] - responses).sum(axis=0)
            best = self.chosen[v] = int(costs.argmin())
            if ripe:
                own = self._photo[seen.photo[row]]
                without = _sharp(rest[row] + own, seen.band[row])
                self.sharp[v] = without < costs[best] + _held(np.unique(own)) + SETTINGS.sharp
            self._blurred[row] = 0.0 if self.sharp[v] else responses[:, best]

    def _find_constants(self) -> None:
        """Of photos in each band, what all share of the depth, then of points."""
        seen = self._seen
        rest = self._left_of(self._texture[seen.point])
        weight = _weight(rest - self._photo[seen.photo])
        held = np.bincount(seen.photo, weight, len(self._photo)) + _HELD
        self._photo = np.bincount(seen.photo, weight * rest, len(self._photo)) / held
        rest = self._left_of(self._texture[seen.point] + self._photo[seen.photo]) + self._common
        for rows, columns in self._of_depth:
            by = columns * _weight(rest[rows] - self._common[rows])[:, None]
            held = (SETTINGS.spread / SETTINGS.depth_spread) ** 2 * np.eye(2)
            self._common[rows] = columns @ np.linalg.solve(columns.T @ by + held, by.T @ rest[rows])
        rest = self._left_of(self._photo[seen.photo])
        weight = _weight(rest - self._texture[seen.point])
        self._texture = np.bincount(seen.point, weight * rest) / np.maximum(np.bincount(seen.point, weight), 1e-9)


def _sharp(rest: Array, band: NDArray[np.int64]) -> float:
    """Cost of a photo that no blur explains, with the constants of its bands that are best then."""
    total = 0.0
    for index in range(len(SETTINGS.widths)):
        mine = rest[band == index]
        constant = float(np.median(mine)) if len(mine) else 0.0
        for _ in range(3):
            weight = _weight(mine - constant)
            constant = float((weight * mine).sum() / (weight.sum() + _HELD))
        total += float(_cost(mine - constant).sum()) + _held(np.array([constant]))
    return total


#: What holds a photo's constant at 0, in observations.
_HELD = (SETTINGS.spread / SETTINGS.photo_spread) ** 2


def _held(constants: Array) -> float:
    """Cost of photos' own constants."""
    return 0.5 * float(np.square(constants / SETTINGS.photo_spread).sum())


def _cost(rest: NDArray[np.floating]) -> Array:
    """Less natural log of the likelihood."""
    return np.asarray(np.log1p(0.5 * np.square(rest / SETTINGS.spread)))


def _weight(rest: Array) -> Array:
    """Of a residual in weighted least squares, as `_cost` has it."""
    return np.asarray(1.0 / (1.0 + 0.5 * np.square(rest / SETTINGS.spread)))


def _responses(sigma: Array, band: NDArray[np.int64], left: Array) -> NDArray[np.float32]:
    """[N, F] natural log of what disks of standard deviations [N, F], px, leave of their band's energy."""
    out = np.zeros(sigma.shape, np.float32)
    for index, row in enumerate(left):
        rows = band == index
        out[rows] = np.interp(sigma[rows], _DISKS, row)
    return out


def _left(first: float, floor: float) -> Array:
    """[T] natural log of the share of a band's energy that disks (`_DISKS`) leave (Airy's law).

    Args:
        first: width of the band's first Gaussian; floor: standard deviation of what blurs all px alike; px.
    """
    f = np.linspace(0.002, 0.5, 400)
    law = f ** (1.0 - SPECTRA.slope) * np.exp(-4 * np.pi**2 * f**2 * floor**2)
    band = np.exp(-2 * np.pi**2 * (f * first) ** 2) - np.exp(-2 * np.pi**2 * (f * first * BANDS.width_ratio) ** 2)
    x = np.maximum(2 * np.pi * f * 2.0 * _DISKS[:, None], 1e-6)  # a disk's radius is twice its standard deviation
    energy = (law * band**2 * np.square(2.0 * j1(x) / x)).sum(axis=1)
    return np.asarray(np.log(energy / energy[0]))
