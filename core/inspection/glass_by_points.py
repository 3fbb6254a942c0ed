"""Frosted glass, seen by the same points in several photos: blur that grows with the depth alike in all of them.

Of a point on a surface, the power of its texture in a band of frequencies *of the surface* is the same from wherever it
is seen. A band of width b px at a point's middle depth is one of b z_m / z px in a photo that sees it from the depth z,
so that no law of scenes' spectra is asked for. What is left between the photos is the blur:

    log power = point + photo + c log cos + R(sigma(z)^2 / (b z_m / z)^2),     sigma(z) = w k(o) (1 - d / z) / (1 - d)

with depths in middle depths, w the width at the middle depth, d the distance of the glass, k(o) what rough glass adds
off the axis. What is seen at a slant (cos: of the angle to the normal) is drawn together, by a power of its own. In
lengths on the surface the blur is in proportion to z - d: that it grows with z at all says how wide it is, and how it
grows where the glass stands. The point's own texture drops out, so photos behind the glass are enough where they see
the same points from depths that differ; where they hardly do, a given width still leaves the distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ..imaging.formation.glass import oblique
from ..numbers import BY_DEFINITION, NOT_CHECKED, number
from .spectra import SETTINGS as SPECTRA

if TYPE_CHECKING:
    from .photo_set import PhotoSet

Array = NDArray[np.float64]

#: What most of the numbers below rest on.
_DRAWN = "one drawn scene behind two glasses and one even blur"


@dataclass(frozen=True)
class GlassByPointsSettings:
    """Numbers of the glass that points show."""

    order: int = number(
        3,
        "count",
        "differences of Gaussians in a row: a steep band asks little of the scene's law within it",
        f"{_DRAWN}: widths 20 to 31 % too wide with 1, 12 to 20 % with 2, 5 % with 3",
        NOT_CHECKED,
    )
    ratio: float = number(1.6, "ratio", "of the two Gaussians of a difference", "a first choice")
    bands: tuple[float, ...] = number((1.0, 1.6, 2.5), "first widths", "of the bands", "a first choice")
    first: float = number(2.0, "px", "width of the first band at least")
    coarser: float = number(1.5, "ratio", "to the next first band, where too few points stand clear of the noise")
    widest_first: float = number(12.0, "px", "of a first band at most")
    clear_points: float = number(0.5, "share of the observations", "that must stand clear of the noise in a band")
    clear: float = number(4.0, "noise power", "from which power counts")
    window: float = number(4.0, "first widths", "of the Gaussian over which power is averaged, on the surface")
    rung: float = number(0.12, "natural log", "between distances at which photos are filtered; linear in between")
    most: int = number(8000, "count", "of observations in a band, of whole points: more cost time and say little more")
    own_variance: float = number(0.3, "px^2", "that sharp photos have: px, lens and colours")
    photo_prior: float = number(8.0, "observations", "that a photo's own constant is held at zero by", "a first choice")
    widest: float = number(3.0, "first widths", "at the middle depth that is tried", "a first choice")
    widths: int = number(13, "count", "that are tried")
    distances: int = number(11, "count", "that are tried up to what is nearest")
    beyond: tuple[float, ...] = number(
        (1.05, 1.2, 1.45), "of what is nearest", "distances that are no glass's but a lens's focus, tried as well"
    )
    stray: float = number(0.02, "share", "of the observations that may be nearer, or farther")
    finer: int = number(7, "count", "of each that are tried around the best, to half a step")
    draws: int = number(100, "count", "of regions of space for the standard errors (bootstrap)")
    neighbours: int = number(12, "count", "of a point, that its normal is taken from", "a first choice")
    least_cosine: float = number(0.1, "cosine", "to a normal at least: what is seen flatter is an edge")
    fewest: int = number(300, "count", "of observations in a band for a statement")
    least_rest: float = number(0.02, "natural log", "of power, that is left between photos at least")
    sure: float = number(2.0, "standard errors", "by which glass must explain more than an even blur", BY_DEFINITION)
    off: float = number(
        0.2,
        "share",
        "of the width, that this is off by whatever the number of points",
        f"{_DRAWN}: +5, +12 and -40 % (the even blur, which is safe)",
        NOT_CHECKED,
    )


SETTINGS = GlassByPointsSettings()


@dataclass(frozen=True)
class GlassShown:
    """A glass as points show it; depths in the cameras' unit.

    Attributes:
        width, width_error: px, standard deviation of the blur on the axis at `middle`, and its standard error.
        distance, distance_error: of the glass.
        middle, nearest, farthest: median depth of the observations, and depths between which nearly all lie.
        grows, grows_error: px by which the width differs between nearest and farthest.
        gain, gain_error: by how much it explains the photos better than the best even blur (log likelihood).
        inside: whether what is sharp lies among what the photos show, as a lens's focus does.
    """

    width: float
    width_error: float
    distance: float
    distance_error: float
    middle: float
    nearest: float
    farthest: float
    grows: float
    grows_error: float
    gain: float
    gain_error: float
    inside: bool

    @property
    def better_than_even(self) -> bool:
        """Whether one point spread for all depths explains less, beyond chance."""
        return self.gain > SETTINGS.sure * self.gain_error and not self.inside

    @property
    def safe_width(self) -> float:
        """px at `middle`: as narrow as the errors allow; too narrow leaves the twin soft, too wide invents detail."""
        return max(0.0, self.width - math.hypot(self.width_error, SETTINGS.off * self.width))

    def sigma(self, depth: float, width: float | None = None) -> float:
        """px on the axis at a depth, `width` at the middle instead of its own."""
        behind = (1.0 - self.distance / depth) / (1.0 - self.distance / self.middle)
        return (self.width if width is None else width) * max(0.0, behind)


@dataclass(frozen=True)
class _Band:
    """Observations of one band that stand clear of the noise, of points that two photos show at least.

    Attributes:
        power: [N] natural log; scale2: [N] squared width of the band, px^2 of the photo.
        depth: [N] in middle depths; wider2: [N] squared widening off the axis.
        slant: [N] natural log of the cosine between the surface's normal and the view, apart from point and photo.
        point, photo, block: [N] numbers from 0.
    """

    power: Array = field(repr=False)
    scale2: Array = field(repr=False)
    depth: Array = field(repr=False)
    wider2: Array = field(repr=False)
    slant: Array = field(repr=False)
    point: NDArray[np.int64] = field(repr=False)
    photo: NDArray[np.int64] = field(repr=False)
    block: NDArray[np.int64] = field(repr=False)

    def rest(self, width: float, distance: float) -> Array:
        """[N] what a glass leaves of the differences between photos."""
        s = SETTINGS
        sigma = width / (1.0 - distance) * (1.0 - distance / self.depth)
        lost = _response((s.own_variance + sigma**2 * self.wider2) / self.scale2)
        left = _between(self.power - lost, self.point, self.photo)
        size = float(self.slant @ self.slant)
        return left - self.slant * (float(self.slant @ left) / size) if size > 0 else left


@dataclass(frozen=True)
class _Costs:
    """What hypotheses leave over, by region of space: widths [W], distances [D], costs [W, D, B]."""

    widths: Array
    distances: Array
    costs: Array = field(repr=False)

    def best(self, weights: Array | None = None) -> tuple[float, float, float]:
        """Width, distance and cost of the best, regions weighted [B]."""
        total = self.costs.sum(axis=2) if weights is None else self.costs @ weights
        i, j = np.unravel_index(int(total.argmin()), total.shape)
        return float(self.widths[i]), float(self.distances[j]), float(total[i, j])


def glass_by_points(photos: PhotoSet, width: float | None = None, at: float | None = None) -> GlassShown | None:
    """Asks the same points in different photos; None where too few are seen.

    Args:
        width: px at the depth `at` (in the cameras' unit) where it is known: only the distance is asked for then.
    """
    observations = photos.observations
    if observations is None:
        return None
    bands = _bands(photos)
    if not bands:
        return None
    depths = observations.depth
    near, far = (float(q) for q in np.quantile(depths, [SETTINGS.stray, 1.0 - SETTINGS.stray]))
    scales = [_scale(band) for band in bands]
    here = 1.0 if at is None else at / observations.median_depth
    widths = _widths(bands) if width is None else np.array([width])
    distances = np.r_[np.linspace(0.0, 0.98, SETTINGS.distances), np.array(SETTINGS.beyond)] * near
    coarse = _costs(bands, scales, widths, distances, here)
    w, d, _ = coarse.best()
    inside = d > near
    close = _around(coarse, w, d, near)
    fine = _costs(bands, scales, close[0], close[1], here)
    w, d, cost = fine.best()
    drawn = _drawn(coarse, fine)
    even = _Costs(coarse.widths, distances[:1], coarse.costs[:, :1])
    gains = np.array([even.best(p)[2] - fine.best(p)[2] for p in _picks(coarse.costs.shape[2])])
    middle = observations.median_depth
    factor = (1.0 - d) / (1.0 - d / here)  # of the width at the middle depth to that at `here`

    def grows(width_: Array | float, distance: Array | float) -> Array:
        ends = [np.abs(1.0 - distance / z) for z in (near, far)]
        return np.asarray(width_ * (ends[1] - ends[0]) / (1.0 - distance / here))

    spread = np.maximum(*(np.std(grows(*draw.T)) for draw in drawn))
    errors = np.maximum(*(draw.std(axis=0) for draw in drawn))
    return GlassShown(
        w * factor, errors[0] * factor, d * middle, errors[1] * middle, middle, near * middle, far * middle,
        float(grows(w, d)), float(spread), even.best()[2] - cost, float(gains.std()), bool(inside),
    )  # fmt: skip


def _widths(bands: list[_Band]) -> Array:
    first = math.sqrt(float(np.median(bands[0].scale2)))
    return np.linspace(0.0, SETTINGS.widest * first, SETTINGS.widths)


def _around(coarse: _Costs, width: float, distance: float, near: float) -> tuple[Array, Array]:
    """Finer widths and distances, to half a step around the best."""

    def finer(values: Array, best: float, most: float) -> Array:
        if len(values) == 1:
            return values
        i = int(np.abs(values - best).argmin())
        low, high = values[max(i - 1, 0)], values[min(i + 1, len(values) - 1)]
        return np.linspace(low, max(min(high, most), low + 1e-6), 2 * SETTINGS.finer - 1)

    return finer(coarse.widths, width, math.inf), finer(coarse.distances, min(distance, near), 0.98 * near)


def _drawn(coarse: _Costs, fine: _Costs) -> tuple[Array, Array]:
    """[draws, 2] widths and distances of drawn regions of space, on both grids."""
    picks = _picks(coarse.costs.shape[2])
    first, second = (np.array([grid.best(p)[:2] for p in picks]) for grid in (coarse, fine))
    return first, second


def _picks(blocks: int) -> Array:
    random = np.random.default_rng(0)
    return random.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SETTINGS.draws).astype(float)


def _costs(bands: list[_Band], scales: list[float], widths: Array, distances: Array, here: float) -> _Costs:
    """Cauchy's cost of each hypothesis; widths at the depth `here`."""
    blocks = 1 + max(int(band.block.max()) for band in bands)
    costs = np.zeros((len(widths), len(distances), blocks))
    for band, scale in zip(bands, scales, strict=True):
        for j, distance in enumerate(distances):
            factor = (1.0 - distance) / (1.0 - distance / here)
            for i, width in enumerate(widths):
                rest = band.rest(width * factor, distance) / scale
                costs[i, j] += np.bincount(band.block, 2.0 * np.log1p(rest**2 / 4.0), blocks)
    return _Costs(widths, distances, costs)


def _scale(band: _Band) -> float:
    """What is left between photos where the best even blur is taken off, natural log."""
    wide = [w * math.sqrt(float(np.median(band.scale2))) for w in (0.0, 0.5, 1.0)]
    left = [1.4826 * float(np.median(np.abs(band.rest(w, 0.0)))) for w in wide]
    return max(min(left), SETTINGS.least_rest)


def _between(values: Array, point: NDArray[np.int64], photo: NDArray[np.int64]) -> Array:
    """Values without what a point has in all photos, and a photo in all points."""
    seen = np.bincount(point)
    values = values - (np.bincount(point, values) / seen)[point]
    held = np.bincount(photo) + SETTINGS.photo_prior
    for _ in range(2):
        values = values - (np.bincount(photo, values) / held)[photo]
        values = values - (np.bincount(point, values) / seen)[point]
    return values


def _bands(photos: PhotoSet) -> list[_Band]:
    """The bands of the finest first width at which most points stand clear of the noise; none where too few do."""
    s, observations = SETTINGS, photos.observations
    assert observations is not None
    light = replace(photos, linear=True)  # its greys are light, which the glass mixes
    first = s.first
    while first <= s.widest_first:
        power = _powers(light, photos, first, first * s.bands[0])
        looked = np.isin(observations.photo, [i for i, n in enumerate(observations.names) if n in _names(photos)])
        if np.isfinite(power).sum() >= s.clear_points * max(looked.sum(), 1):
            break
        first *= s.coarser
    else:
        return []
    rows = [power, *(_powers(light, photos, first, first * band) for band in s.bands[1:])]
    found = [_band_of(photos, row, first * band) for row, band in zip(rows, s.bands, strict=True)]
    return [band for band in found if band is not None]


def _names(photos: PhotoSet) -> set[str]:
    return {photo.name for photo in photos.looked_at}


def _nearness(photos: PhotoSet) -> Array:
    """[N] a point's middle depth over its depth in the photo."""
    observations = photos.observations
    assert observations is not None
    log = np.log(observations.depth)
    count = np.maximum(np.bincount(observations.point), 1)
    return np.asarray(np.exp((np.bincount(observations.point, log) / count)[observations.point] - log))


def _powers(light: PhotoSet, photos: PhotoSet, first: float, width: float) -> Array:
    """[N] log power over squared light of a band, width in px at a point's middle depth; NaN where noise has it."""
    s, observations = SETTINGS, photos.observations
    assert observations is not None
    nearer = _nearness(photos)
    low, high = math.log(nearer.min()), math.log(nearer.max()) + 1e-9
    ladder = np.linspace(low, high, 2 + int((high - low) / s.rung))
    out = np.full(len(observations), np.nan)
    for photo, grey, noise in zip(light.looked_at, light.greys, light.grey_noise, strict=True):
        if photo.name not in observations.names:
            continue
        mine = np.flatnonzero(observations.photo == observations.names.index(photo.name))
        if not len(mine):
            continue
        at = observations.pixel[mine].T[::-1] - 0.5
        place = np.interp(np.log(nearer[mine]), ladder, np.arange(len(ladder)))
        below = np.minimum(place.astype(int), len(ladder) - 2)
        rows = np.full((len(ladder), len(mine)), np.nan)
        for k in np.unique(np.r_[below, below + 1]):
            factor = math.exp(ladder[k])
            rows[k] = _power_at(grey, noise, at, width * factor, s.window * first * factor)
        share, each = place - below, np.arange(len(mine))
        out[mine] = (1.0 - share) * rows[below, each] + share * rows[below + 1, each]
    return out


def _power_at(grey: NDArray[np.float32], noise: float, at: Array, width: float, window: float) -> Array:
    """[n] log power of a band at px [2, n] of a photo."""
    variances, signs = _difference(width)
    passed = np.zeros(grey.shape, np.float32)
    for variance, sign in zip(variances, signs, strict=True):
        passed += np.float32(sign) * ndimage.gaussian_filter(grey, math.sqrt(variance), truncate=3.5)
    power, level = (ndimage.gaussian_filter(plane, window, truncate=2.5) for plane in (passed**2, grey))
    power, level = (ndimage.map_coordinates(plane, at, order=1, mode="nearest") for plane in (power, level))
    gain = float((signs[:, None] * signs / (variances[:, None] + variances)).sum()) / (2.0 * math.pi)
    own = noise**2 * gain
    counts = (power > SETTINGS.clear * own) & (level > 0.005)
    return np.where(counts, np.log(np.maximum(power - own, 1e-12) / np.maximum(level, 0.005) ** 2), np.nan)


def _difference(width: float) -> tuple[Array, Array]:
    """Variances and factors of the Gaussians that differences in a row are the sum of."""
    order, wide = SETTINGS.order, SETTINGS.ratio**2
    k = np.arange(order + 1)
    factors = np.array([math.comb(order, i) for i in k]) * (-1.0) ** k
    return width**2 * (order - k + k * wide), factors


def _slants(photos: PhotoSet) -> Array:
    """[N] natural log of the cosine between a point's normal, by its neighbours, and the view of it."""
    observations, cameras = photos.observations, photos.cameras
    assert observations is not None and cameras is not None
    away = observations.direction
    where = np.stack([cameras.poses[name].centre for name in observations.names])[observations.photo]
    poses = [cameras.poses[name] for name in observations.names]
    # A point's place: along its ray from the photo's middle, as deep as it was seen.
    axis = np.stack([pose.rotation[2] for pose in poses])[observations.photo]
    way = observations.depth * observations.median_depth / np.maximum(-(away * axis).sum(axis=1), 1e-6)
    place = where - away * way[:, None]
    count = int(observations.point.max()) + 1
    seen = np.maximum(np.bincount(observations.point, minlength=count), 1)
    middle = np.stack([np.bincount(observations.point, p, count) / seen for p in place.T], axis=1)
    cloud = cKDTree(cameras.points.positions)
    _, near = cloud.query(middle, k=min(SETTINGS.neighbours, len(cameras.points.positions)))
    local = cameras.points.positions[near]
    local = local - local.mean(axis=1, keepdims=True)
    normal = np.linalg.eigh(np.einsum("pki,pkj->pij", local, local))[1][:, :, 0]
    cosine = np.abs((normal[observations.point] * away).sum(axis=1))
    return np.asarray(np.log(np.maximum(cosine, SETTINGS.least_cosine)))


def _response_table() -> tuple[Array, Array]:
    """Blur's variance over the band's squared width, and the natural log of the power that is left."""
    u = np.linspace(0.002, 1.2, 1200)
    passed = np.exp(-2 * np.pi**2 * u**2) - np.exp(-2 * np.pi**2 * (u * SETTINGS.ratio) ** 2)
    law = u ** (1.0 - SPECTRA.slope) * passed ** (2 * SETTINGS.order)
    at = np.r_[np.linspace(0.0, 4.0, 300), np.linspace(4.05, 60.0, 500)]
    left = (law * np.exp(-4 * np.pi**2 * u**2 * at[:, None])).sum(axis=1)
    return at, np.log(left / left[0])


_RESPONSE = _response_table()


def _response(variance: Array) -> Array:
    return np.interp(variance, *_RESPONSE)


def _band_of(photos: PhotoSet, power: Array, width: float) -> _Band | None:
    observations, cameras = photos.observations, photos.cameras
    assert observations is not None and cameras is not None
    point = observations.point
    use = np.isfinite(power)
    use &= point % max(1, -(-int(use.sum()) // SETTINGS.most)) == 0
    use &= np.bincount(point[use], minlength=int(point.max()) + 1)[point] >= 2
    if use.sum() < SETTINGS.fewest:
        return None
    numbers = np.unique(point[use], return_inverse=True)[1]
    lenses = [cameras.lenses[name] for name in observations.names]
    focal = np.array([math.sqrt(lens.fx * lens.fy) for lens in lenses])[observations.photo]
    half = np.array([math.hypot(lens.width, lens.height) / 2 for lens in lenses])[observations.photo]
    wider = oblique((observations.radius * half / focal) ** 2)
    return _Band(
        power[use],
        ((width * _nearness(photos)) ** 2)[use],
        observations.depth[use],
        wider[use] ** 2,
        _between(_slants(photos)[use], numbers, observations.photo[use]),
        numbers,
        observations.photo[use],
        observations.block[use],
    )
