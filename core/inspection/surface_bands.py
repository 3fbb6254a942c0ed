"""Power of bands of frequencies of the surface, of the same points in several photos.

A band of width b px at a point's middle depth is one of b z_m / z px in a photo that sees the point from the depth z:
the same lengths on the surface, so that its own texture has the same power in all photos.
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
from ..numbers import NOT_CHECKED, number
from .band_kernels import interpolate, take_off_common
from .edges import averaged
from .spectra import SETTINGS as SPECTRA

if TYPE_CHECKING:
    from ..photos.load import Photo
    from .photo_set import PhotoSet

Array = NDArray[np.float64]

#: What the steepness of the bands was chosen on.
_DRAWN = "one drawn scene behind two glasses and one even blur"


@dataclass(frozen=True)
class SurfaceBandSettings:
    """Numbers of the bands."""

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
    finest: float = number(1.7, "px", "photos are averaged until the narrowest Gaussian is so wide: time only")
    window: float = number(4.0, "first widths", "of the Gaussian over which power is averaged, on the surface")
    rung: float = number(0.12, "natural log", "between distances at which photos are filtered; linear in between")
    most: int = number(8000, "count", "of observations in a band, of whole points: more cost time and say little more")
    neighbours: int = number(12, "count", "of a point, that its normal is taken from", "a first choice")
    least_cosine: float = number(0.1, "cosine", "to a normal at least: what is seen flatter is an edge")
    fewest: int = number(300, "count", "of observations in a band for a statement")
    photo_prior: float = number(8.0, "observations", "that a photo's own constant is held at zero by", "a first choice")
    slopes: tuple[float, float] = number(
        (0.0, SPECTRA.slope),
        "exponent",
        "of a texture's power over frequency that it may have: a steeper one is blur that is not taken off",
        "three drawn scenes behind an even blur of 4 px: 2.5 to 3.4 without a limit, and growth that is not there",
        NOT_CHECKED,
    )
    slope_step: float = number(0.25, "exponent", "between those for which what a blur leaves is kept; linear between")


SETTINGS = SurfaceBandSettings()


@dataclass(frozen=True)
class Band:
    """Observations of one band that stand clear of the noise, of points that two photos show at least.

    Attributes:
        power: [N] natural log; scale2: [N] squared width of the band, px^2 of the photo.
        depth: [N] in middle depths; wider2: [N] squared widening off the axis.
        slant: [N] natural log of the cosine between the surface's normal and the view, apart from point and photo.
        point, photo, block: [N] numbers from 0; observation: [N] which of the photos' observations.
        width: px at a point's middle depth.
    """

    power: Array = field(repr=False)
    scale2: Array = field(repr=False)
    depth: Array = field(repr=False)
    wider2: Array = field(repr=False)
    slant: Array = field(repr=False)
    point: NDArray[np.int64] = field(repr=False)
    photo: NDArray[np.int64] = field(repr=False)
    block: NDArray[np.int64] = field(repr=False)
    observation: NDArray[np.int64] = field(repr=False)
    width: float

    def unexplained(self, lost: Array) -> Array:
        """[N] what differs between photos of a point beside a blur that leaves `lost` [N] (log power) and the slant."""
        left = between(self.power - lost, self.point, self.photo)
        size = float(self.slant @ self.slant)
        return left - self.slant * (float(self.slant @ left) / size) if size > 0 else left


def between(values: Array, point: NDArray[np.int64], photo: NDArray[np.int64]) -> Array:
    """Values without what a point has in all photos, and a photo in all points."""
    left = np.array(values, np.float64)
    seen, held = np.bincount(point).astype(np.float64), np.bincount(photo) + SETTINGS.photo_prior
    take_off_common(left, point, photo, seen, held, 2)
    return left


def surface_bands(photos: PhotoSet) -> list[Band]:
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

    def look(photo: Photo, grey: NDArray[np.float32], noise: float) -> None:
        """One photo's own places of `out`."""
        if photo.name not in observations.names:
            return
        mine = np.flatnonzero(observations.photo == observations.names.index(photo.name))
        if not len(mine):
            return
        at = observations.pixel[mine].T[::-1] - 0.5
        place = np.interp(np.log(nearer[mine]), ladder, np.arange(len(ladder)))
        below = np.minimum(place.astype(int), len(ladder) - 2)
        rows = np.full((len(ladder), len(mine)), np.nan)
        for k in np.unique(np.r_[below, below + 1]):
            factor = math.exp(ladder[k])
            rows[k] = _power_at(grey, noise, at, width * factor, s.window * first * factor)
        share, each = place - below, np.arange(len(mine))
        out[mine] = (1.0 - share) * rows[below, each] + share * rows[below + 1, each]

    light.of_each(look, light.looked_at, light.greys, light.grey_noise)
    return out


def _power_at(grey: NDArray[np.float32], noise: float, at: Array, width: float, window: float) -> Array:
    """[n] log power of a band at px [2, n] of a photo."""
    variances, signs = _difference(width)
    by = max(1, int(math.sqrt(variances[0]) / SETTINGS.finest))
    small = averaged(grey, by)
    passed = np.zeros(small.shape, np.float32)
    for variance, sign in zip(variances, signs, strict=True):
        done = (by * by - 1) / 12.0  # that averaging has blurred already
        passed += np.float32(sign) * ndimage.gaussian_filter(small, math.sqrt(variance - done) / by, truncate=3.5)
    power, level = (ndimage.gaussian_filter(plane, window / by, truncate=2.5) for plane in (passed**2, small))
    place = (at + 0.5) / by - 0.5
    power, level = (ndimage.map_coordinates(plane, place, order=1, mode="nearest") for plane in (power, level))
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


#: [S] exponents of textures' power for which what a blur leaves is kept.
TEXTURES = np.linspace(*SETTINGS.slopes, 1 + round((SETTINGS.slopes[1] - SETTINGS.slopes[0]) / SETTINGS.slope_step))


#: Up to which variance (over the band's squared width) the tables are fine, and how many of their places are there.
_EVEN, _FINE = 4.0, 300


def _response_tables() -> tuple[Array, Array, Array]:
    """Exponents of textures' power, blur's variance over the band's squared width, natural log of the power left."""
    u = np.linspace(0.002, 1.2, 1200)
    passed = np.exp(-2 * np.pi**2 * u**2) - np.exp(-2 * np.pi**2 * (u * SETTINGS.ratio) ** 2)
    at = np.r_[np.linspace(0.0, _EVEN, _FINE), np.linspace(_EVEN + 0.05, 60.0, 500)]
    laws = u ** (1.0 - TEXTURES[:, None]) * passed ** (2 * SETTINGS.order)
    left = laws @ np.exp(-4 * np.pi**2 * u[:, None] ** 2 * at)
    return TEXTURES, at, np.log(left / left[:, :1])


_RESPONSES = _response_tables()


def response(variance: Array, slope: float = SPECTRA.slope) -> Array:
    """[N] natural log of the power that a blur leaves of a band, given its variance over the band's squared width.

    Args:
        slope: exponent by which the texture's power falls with the frequency: a flat one loses more of a band.
    """
    slopes, at, left = _RESPONSES
    place = float(np.clip(np.interp(slope, slopes, np.arange(len(slopes))), 0, len(slopes) - 1.0001))
    below, share = int(place), place - int(place)
    found = np.empty(len(variance))
    values = (1.0 - share) * left[below] + share * left[below + 1]
    interpolate(variance, at, _FINE, 1.0 / (at[1] - at[0]), 1.0 / (at[-1] - at[-2]), values, found)
    return found


def texture_slope(bands: list[Band], lost: list[Array]) -> float:
    """Exponent by which the texture's power falls with the frequency, by what bands hold without blur.

    Args:
        lost: for each band [N] natural log of the power that the blur has left of it.

    Returns:
        The prior's where bands share too few observations.
    """
    common = bands[0].observation
    for band in bands[1:]:
        common = np.intersect1d(common, band.observation, assume_unique=True)
    if len(bands) < 2 or len(common) < SETTINGS.fewest:
        return SPECTRA.slope
    levels = [
        float(np.mean((band.power - less)[np.searchsorted(band.observation, common)]))
        for band, less in zip(bands, lost, strict=True)
    ]
    rise = np.polyfit(np.log([band.width for band in bands]), levels, 1)[0]
    return float(np.clip(2.0 + rise, *SETTINGS.slopes))


def _band_of(photos: PhotoSet, power: Array, width: float) -> Band | None:
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
    return Band(
        power[use],
        ((width * _nearness(photos)) ** 2)[use],
        observations.depth[use],
        wider[use] ** 2,
        between(_slants(photos)[use], numbers, observations.photo[use]),
        numbers,
        observations.photo[use],
        observations.block[use],
        np.flatnonzero(use),
        width,
    )
