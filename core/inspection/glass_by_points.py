"""Frosted glass, seen by the same points in several photos: blur that grows with the depth alike in all of them.

Of a point on a surface, the power of its texture in a band of frequencies *of the surface* is the same from wherever it
is seen. A band of width b px at a point's middle depth is one of b z_m / z px in a photo that sees it from the depth z.
What is left between the photos is the blur:

    log power = point + photo + c log cos + R(sigma(z)^2 / (b z_m / z)^2; a)
    sigma(z) = w k(o) (1 - d / z) / (1 - d)

with depths in middle depths, w the width at the middle depth, d the distance of the glass, k(o) what rough glass adds
off the axis. How much a blur takes of a band depends on the law of the texture within it (its exponent a), which the
bands' own powers say once the blur is taken off; both are found by turns. What is seen at a slant (cos: of the angle to
the normal) is drawn together, by a power of its own. In lengths on the surface the blur is in proportion to z - d: that
it grows with z at all says how wide it is, and how it grows where the glass stands. The point's own texture drops out,
so photos behind the glass are enough where they see the same points from depths that differ; where they hardly do, a
given width still leaves the distance.

It is held against two blurs that do not grow: one point spread for all photos and places, of whichever width and
texture, and what a glass right at the camera would make of them, which is wider off the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..numbers import BY_DEFINITION, NOT_CHECKED, number
from .edge_depth import SETTINGS as EDGES
from .spectra import SETTINGS as SPECTRA
from .surface_bands import TEXTURES, Band, response, surface_bands, texture_slope

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..imaging.formation.glass import Stand
    from .edge_depth import LoneWidths
    from .photo_set import PhotoSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GlassByPointsSettings:
    """Numbers of the glass that points show."""

    own_variance: float = number(0.3, "px^2", "that sharp photos have: px, lens and colours")
    widest: float = number(3.0, "first widths", "at the middle depth that is tried", "a first choice")
    widths: int = number(13, "count", "that are tried")
    distances: int = number(11, "count", "that are tried up to what is nearest")
    beyond: tuple[float, ...] = number(
        (1.05, 1.2, 1.45), "of what is nearest", "distances that are no glass's but a lens's focus, tried as well"
    )
    narrow: float = number(
        0.25,
        "quantile",
        "of the widths of edges that stand alone: some are soft themselves",
        "four sets behind Cycles' glass",
        NOT_CHECKED,
    )
    least_behind: float = number(0.02, "share", "of the far blur, at least, where a width is given: not zero")
    stray: float = number(0.02, "share", "of the observations that may be nearer, or farther")
    finer: int = number(7, "count", "of each that are tried around the best, to half a step")
    rounds: int = number(5, "count", "in which the texture's law and the glass are found by turns, at most")
    settled: float = number(0.05, "exponent", "by which the law changes in a round that is the last")
    draws: int = number(100, "count", "of regions of space for the standard errors (bootstrap)")
    least_rest: float = number(0.02, "natural log", "of power, that is left between photos at least")
    sure: float = number(
        2.0, "standard errors", "by which glass must explain more than what does not grow", BY_DEFINITION
    )
    even_widths: int = number(25, "count", "of an even point spread, that are tried up to the widest")
    even_of_edges: tuple[float, float] = number(
        (0.85, 1.25),
        "ratio",
        "to the width that edges show, between which an even point spread may be, where none stand alone",
        "what such edges are off by: up to a fifth too narrow, 7 % besides",
        "0 of 36 drawn even blurs taken for glass",
    )
    off: float = number(
        0.2,
        "share",
        "of the width, that this is off by whatever the number of points",
        "six drawn sets behind glass: -6 to +12 %; of the texture by its own law",
        NOT_CHECKED,
    )


SETTINGS = GlassByPointsSettings()


@dataclass(frozen=True)
class Gain:
    """By how much one hypothesis explains the photos better than another, and its standard error (log likelihood)."""

    value: float
    error: float

    @classmethod
    def over(cls, other: Array, costs: Array, picks: Array) -> Gain:
        """Of costs [B] by region of space over another's; picks: [draws, B] of `drawn_regions`."""
        gained = other - costs
        return cls(float(gained.sum()), float((picks @ gained).std()))

    @property
    def errors(self) -> float:
        """In standard errors."""
        return self.value / max(self.error, 1e-9)


@dataclass(frozen=True)
class GlassPlane:
    """A sheet that leans, or that stands in the world, as points show it.

    Attributes:
        far: px, standard deviation of the blur far behind it.
        distance, distance_error: on the axis, in the cameras' unit; of a standing one before the middle camera.
        lean, lean_error: [2] tangents of the angles by which its normal leans towards the right and downwards.
        standing: whether it stands in the world instead of moving with the camera.
        over_parallel: gain over the best parallel sheet.
        over_even: gain over the best point spread that is the same in all photos and places.
        stands: where all cameras stand against the middle one, of a standing sheet.
    """

    far: float
    distance: float
    distance_error: float
    lean: tuple[float, float]
    lean_error: tuple[float, float]
    standing: bool
    over_parallel: Gain
    over_even: Gain
    stands: Mapping[str, Stand] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class GlassShown:
    """A glass as points show it, parallel to the sensor; depths in the cameras' unit.

    Attributes:
        width, width_error: px, standard deviation of the blur on the axis at `middle`, and its standard error.
        distance, distance_error: of the glass.
        middle, nearest, farthest: median depth of the observations, and depths between which nearly all lie.
        grows, grows_error: px by which the width differs between nearest and farthest.
        over_even: gain over the best point spread that is the same in all photos and places.
        over_camera: gain over the best glass right at the camera, whose blur does not grow.
        inside: whether what is sharp lies among what the photos show, as a lens's focus does.
        slope: exponent of the texture's power.
        even: [B] cost of the best point spread that is the same everywhere, by region of space.
        given: whether the width was, and only the distance is asked of the points.
        plane: the sheet where it leans or stands beyond chance; None where a parallel one explains as much.
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
    over_even: Gain
    over_camera: Gain
    inside: bool
    slope: float
    even: Array = field(repr=False, default_factory=lambda: np.zeros(0))
    given: bool = False
    plane: GlassPlane | None = None

    @property
    def better_than_even(self) -> bool:
        """Whether blurs that do not grow explain less, beyond chance."""
        over_even = self.over_even if self.plane is None else self.plane.over_even
        return self.may_grow and over_even.errors > SETTINGS.sure

    @property
    def may_grow(self) -> bool:
        """Whether a glass right at the camera explains less, beyond chance."""
        return self.over_camera.errors > SETTINGS.sure and not self.inside

    @property
    def safe_width(self) -> float:
        """px at `middle`: as narrow as the errors allow; too narrow leaves the twin soft, too wide invents detail."""
        off = 0.0 if self.given else SETTINGS.off * self.width
        return max(0.0, self.width - math.hypot(self.width_error, off))

    def sigma(self, depth: float, width: float | None = None) -> float:
        """px on the axis at a depth, `width` at the middle instead of its own."""
        behind = (1.0 - self.distance / depth) / (1.0 - self.distance / self.middle)
        return (self.width if width is None else width) * max(0.0, behind)


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

    def least(self) -> Array:
        """[B] costs of the best."""
        total = self.costs.sum(axis=2)
        return np.asarray(self.costs.reshape(-1, self.costs.shape[2])[int(total.argmin())])


@dataclass(frozen=True)
class _Tried:
    """What hypotheses are held against.

    Attributes:
        bands, scales: of the photos, and what is left in each at best.
        here: depth that widths are given at, over the middle one.
        slope: exponent of the texture's power.
        alone: edges that say how wide each glass blurs; None where the widths do that are tried.
        middle: depth in the cameras' unit.
    """

    bands: list[Band]
    scales: list[float]
    here: float
    slope: float
    middle: float
    alone: LoneWidths | None = None

    def of_texture(self, slope: float) -> _Tried:
        """The same of another texture."""
        return replace(self, scales=[even_rest(band, slope) for band in self.bands], slope=slope)

    def far(self, width: float, distance: float) -> float:
        """px, blur far behind a glass."""
        if self.alone is None:
            return width / _behind(distance, self.here)
        behind = np.maximum(np.abs(1.0 - distance * self.middle / self.alone.depths), SETTINGS.least_behind)
        return narrow(self.alone.on_axis / behind)

    def grows(self, width: float, distance: float, ends: tuple[float, float]) -> float:
        """px by which the blur at the far end is wider than at the near one."""
        near, far = (abs(1.0 - distance / end) for end in ends)
        return self.far(width, distance) * (far - near)

    def costs(self, widths: Array, distances: Array) -> _Costs:
        """Cauchy's cost of each pair, by region of space."""
        costs = [[self._cost(float(width), float(distance)) for distance in distances] for width in widths]
        return _Costs(widths, distances, np.array(costs))

    def _cost(self, width: float, distance: float) -> Array:
        """[B] of one pair."""
        far = self.far(width, distance)
        return left_over(self.bands, self.scales, [_lost(band, far, distance, self.slope) for band in self.bands])

    def texture(self, width: float, distance: float) -> float:
        """Exponent of the texture's power as a glass leaves it."""
        far = self.far(width, distance)
        return texture_slope(self.bands, [_lost(band, far, distance, self.slope) for band in self.bands])


def narrow(widths: Array) -> float:
    """Of the widths that edges show: some are soft themselves, none that stands alone is narrower than the blur."""
    return float(np.quantile(widths, SETTINGS.narrow))


def lost(band: Band, sigma2: Array, slope: float) -> Array:
    """[N] natural log of the power that a blur leaves of a band; sigma2: [N] px^2, without the photos' own."""
    return response((SETTINGS.own_variance + sigma2) / band.scale2, slope)


def cauchy(left: Array, scale: float) -> Array:
    """[N] cost of what is left."""
    return 2.0 * np.log1p((left / scale) ** 2 / 4.0)


def left_over(bands: list[Band], scales: list[float], less: list[Array]) -> Array:
    """[B] cost by region of space of what differs between photos beside a blur; less: its loss of each band [N]."""
    blocks = 1 + max(int(band.block.max()) for band in bands)
    total = np.zeros(blocks)
    for band, scale, lost_of_band in zip(bands, scales, less, strict=True):
        total += np.bincount(band.block, cauchy(band.unexplained(lost_of_band), scale), blocks)
    return total


def _even_costs(tried: _Tried, widths: Array) -> Array:
    """[B] cost by region of space of the best point spread that is the same everywhere, of whichever texture."""

    def of(width: float, slope: float) -> Array:
        less = [lost(band, np.full(len(band.power), width**2), slope) for band in tried.bands]
        return left_over(tried.bands, tried.scales, less)

    return min((of(float(w), float(a)) for a in TEXTURES for w in widths), key=lambda costs: float(costs.sum()))


def _even_widths(tried: _Tried, width: float | None) -> Array:
    """px that an even point spread may have: what edges show, as far as they may be off (two standard errors).

    Args:
        width: that edges show of which none stand alone; None where they do not say.
    """
    if tried.alone is not None:
        off = 2.0 * EDGES.off
        return narrow(tried.alone.widths) * np.linspace(1.0 - off, 1.0 + off, SETTINGS.finer)
    if width is not None:
        return width * np.linspace(*SETTINGS.even_of_edges, SETTINGS.finer)
    return _widths(tried.bands, SETTINGS.even_widths)


def _lost(band: Band, far: float, distance: float, slope: float) -> Array:
    """[N] natural log of the power that a glass leaves of a band; far: px, its blur of what is far behind it."""
    return lost(band, (far * (1.0 - distance / band.depth)) ** 2 * band.wider2, slope)


def glass_by_points(
    photos: PhotoSet, width: float | None = None, at: float | None = None, alone: LoneWidths | None = None
) -> GlassShown | None:
    """Asks the same points in different photos; None where too few are seen.

    Args:
        width: px at the depth `at` (in the cameras' unit) where it is known: only the distance is asked for then.
        alone: edges that say instead how wide a glass blurs.
    """
    observations = photos.observations
    bands = [] if observations is None else photos.once(surface_bands)
    if observations is None or not bands:
        return None
    middle = observations.median_depth
    ends = np.quantile(observations.depth, [SETTINGS.stray, 1.0 - SETTINGS.stray])
    given = width is not None or alone is not None
    widths = np.array([width or 0.0]) if given else _widths(bands, SETTINGS.widths)
    distances = np.r_[np.linspace(0.0, 0.98, SETTINGS.distances), np.array(SETTINGS.beyond)] * ends[0]
    slope = SPECTRA.slope
    tried = _Tried(bands, [], 1.0 if at is None else at / middle, slope, middle, alone)
    for _ in range(SETTINGS.rounds):
        tried = tried.of_texture(slope)
        coarse = tried.costs(widths, distances)
        w, d, _ = coarse.best()
        slope, before = tried.texture(w, d), slope
        if abs(slope - before) < SETTINGS.settled:
            break
    fine = tried.costs(*_around(coarse, w, d, float(ends[0])))
    even = _even_costs(tried, _even_widths(tried, width))
    shown = _shown(coarse, fine, even, middle, (float(ends[0]), float(ends[1])), tried, inside=d > ends[0])
    return replace(shown, given=given)


def _shown(
    coarse: _Costs, fine: _Costs, even: Array, middle: float, ends: tuple[float, float], tried: _Tried, inside: bool
) -> GlassShown:
    """The best of the fine grid; errors by drawn regions of space, of whichever grid says more.

    Args:
        middle: median depth in the cameras' unit; ends: nearest and farthest over it.
    """
    w, d, _ = fine.best()
    picks = drawn_regions(coarse.costs.shape[2])
    drawn = [np.array([grid.best(p)[:2] for p in picks]) for grid in (coarse, fine)]
    grown = [np.array([tried.grows(float(width), float(distance), ends) for width, distance in draw]) for draw in drawn]
    errors = np.maximum(drawn[0].std(axis=0), drawn[1].std(axis=0))
    camera = _Costs(coarse.widths, coarse.distances[:1], coarse.costs[:, :1])
    over_camera = np.array([camera.best(p)[2] - fine.best(p)[2] for p in picks])
    behind = _behind(d, 1.0)
    return GlassShown(
        width=tried.far(w, d) * behind,
        width_error=float(errors[0]) * behind / _behind(d, tried.here),
        distance=d * middle,
        distance_error=float(errors[1]) * middle,
        middle=middle,
        nearest=ends[0] * middle,
        farthest=ends[1] * middle,
        grows=tried.grows(w, d, ends),
        grows_error=max(float(grown[0].std()), float(grown[1].std())),
        over_even=Gain.over(even, fine.least(), picks),
        over_camera=Gain(camera.best()[2] - fine.best()[2], float(over_camera.std())),
        inside=bool(inside),
        slope=tried.slope,
        even=even,
    )


def _behind(distance: float, depth: float) -> float:
    """What blur at a depth is in proportion to, away from zero (a focus may be tried where the width is given)."""
    return max(abs(1.0 - distance / depth), SETTINGS.least_behind)


def _widths(bands: list[Band], count: int) -> Array:
    first = math.sqrt(float(np.median(bands[0].scale2)))
    return np.linspace(0.0, SETTINGS.widest * first, count)


def _around(coarse: _Costs, width: float, distance: float, near: float) -> tuple[Array, Array]:
    """Finer widths and distances, to half a step around the best."""

    def finer(values: Array, best: float, most: float) -> Array:
        if len(values) == 1:
            return values
        i = int(np.abs(values - best).argmin())
        low, high = values[max(i - 1, 0)], values[min(i + 1, len(values) - 1)]
        return np.linspace(low, max(min(high, most), low + 1e-6), 2 * SETTINGS.finer - 1)

    return finer(coarse.widths, width, math.inf), finer(coarse.distances, min(distance, near), 0.98 * near)


def drawn_regions(blocks: int) -> Array:
    """[draws, blocks] how often each region of space counts, by chance (bootstrap)."""
    random = np.random.default_rng(0)
    return random.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SETTINGS.draws).astype(float)


def even_rest(band: Band, slope: float) -> float:
    """What is left between photos where the best even blur is taken off, natural log."""
    wide = [w * math.sqrt(float(np.median(band.scale2))) for w in (0.0, 0.5, 1.0)]
    left = [1.4826 * float(np.median(np.abs(band.unexplained(_lost(band, w, 0.0, slope))))) for w in wide]
    return max(min(left), SETTINGS.least_rest)
