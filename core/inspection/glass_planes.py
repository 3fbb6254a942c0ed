"""A sheet of frosted glass that leans, or stands in the world: which of these the same points show.

A sheet is a plane v X = 1 in each camera's axes. Light from X meets it at the share 1 / (v X) of its way, and is
blurred in proportion to the rest. One that moves with the camera has the same v = (a, b, 1) / d in all photos (d: its
distance on the axis; a, b: tangents of its lean), one that stands has its own in each, all of which follow from the one
before the middle camera. What `glass_by_points` asks of distances is asked of d, a and b here: the plane is taken that
leaves least of what differs between photos of the same points, if a parallel one leaves more beyond chance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..imaging.formation.glass import GLASS, oblique
from ..imaging.formation.stands import stands_between
from ..numbers import NOT_CHECKED, number
from .edge_depth import SETTINGS as EDGES
from .edge_depth import width_of_edges
from .glass_by_points import (
    Gain,
    GlassPlane,
    GlassShown,
    drawn_regions,
    even_rest,
    glass_by_points,
    left_over,
    lost,
    narrow,
)
from .surface_bands import Band, surface_bands, texture_slope

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..imaging.formation.glass import Stand
    from .edge_depth import LoneWidths
    from .photo_set import PhotoSet

Array = NDArray[np.float64]

#: What the search was written on.
DRAWN = "six drawn sets behind glass that leans or stands"


@dataclass(frozen=True)
class GlassPlaneSettings:
    """Numbers of the search for planes."""

    distances: tuple[float, ...] = number(
        (0.2, 0.33, 0.45, 0.58, 0.7, 0.83, 0.95), "of what is nearest", "distances of a parallel sheet tried first"
    )
    leans: tuple[float, ...] = number((-0.4, 0.0, 0.4), "tangent", "of both angles, that searches may begin from")
    widths: tuple[float, ...] = number(
        (0.6, 1.0, 1.6, 2.5), "ratio", "to the blur of a parallel sheet, tried first where no edges say how wide it is"
    )
    searches: int = number(3, "count", "from the best of these")
    steps: int = number(300, "count", "of a search at most: time only")
    first_step: tuple[float, float, float] = number(
        (0.03, 0.15, 0.1), "middle depths; tangent; share", "of distance, leans and width in a search"
    )
    done: float = number(0.3, "log likelihood", "by which a search's best differ when it ends")
    rounds: int = number(2, "count", "in which the texture's law and the plane are found by turns")
    nearest: float = number(0.02, "middle depths", "of a distance at least")
    steepest: float = number(1.7, "tangent", "of a lean at most: 60 degrees")
    seen_along: float = number(0.05, "cosine", "between light and the plane's normal, at least")
    small: tuple[float, float, float] = number(
        (0.01, 0.02, 0.02), "middle depths; tangent; share", "by which errors are measured: differences", NOT_CHECKED
    )
    least_behind: float = number(0.02, "share", "of an edge's blur far behind the sheet, at least")
    sure: float = number(
        2.5,
        "standard errors",
        "by which a plane must explain more than a parallel sheet",
        f"{DRAWN} (2.7 and more) and one behind Cycles' (a wrong lean: 2.4)",
        "seven more drawn sets: parallel sheets 0.8 and 0.6, three that stand 4.8 to 5.0, two that lean 1.0 and 2.0",
    )


SETTINGS = GlassPlaneSettings()


@dataclass(frozen=True)
class _Seen:
    """Where something is seen: tangents off the axis [N], depth in middle depths [N], row of the cameras [N]."""

    x: Array
    y: Array
    depth: Array
    photo: NDArray[np.int64]

    def chosen(self, which: NDArray[np.int64]) -> _Seen:
        return _Seen(self.x[which], self.y[which], self.depth[which], self.photo[which])

    def behind(self, planes: Array) -> Array:
        """[N] blur over that far behind the plane of each photo [V, 3], as wide as it is off the axis."""
        right, down, ahead = planes.T[:, self.photo]
        nearness = right * self.x + down * self.y + ahead
        met = np.maximum(nearness, GLASS.grazing * np.abs(ahead))
        tangent2 = self.x**2 + self.y**2
        cosine = met / np.sqrt((planes**2).sum(axis=1)[self.photo] * (1.0 + tangent2))
        wider = oblique(tangent2, np.clip(cosine, SETTINGS.seen_along, 1.0))
        return np.asarray(np.clip(1.0 - 1.0 / (met * self.depth), 0.0, None) * wider)


@dataclass(frozen=True)
class _Rig:
    """The cameras, in the order of the observations' names.

    Attributes:
        stands: of each against the middle one, in the cameras' unit.
        turn, moved: [V, 3, 3] and [V, 3], the same in middle depths.
        focal, half: [V, 2] px, focal lengths and half the photo's size; middle: depth in the cameras' unit.
    """

    stands: Mapping[str, Stand] = field(repr=False)
    turn: Array = field(repr=False)
    moved: Array = field(repr=False)
    focal: Array = field(repr=False)
    half: Array = field(repr=False)
    middle: float

    @classmethod
    def of(cls, photos: PhotoSet) -> _Rig:
        observations, cameras = photos.observations, photos.cameras
        assert observations is not None and cameras is not None
        poses = [cameras.poses[name] for name in observations.names]
        lenses = [cameras.lenses[name] for name in observations.names]
        stands = stands_between(dict(zip(observations.names, poses, strict=True)))
        return cls(
            stands,
            np.array([stand.turn for stand in stands.values()]),
            np.array([stand.moved for stand in stands.values()]) / observations.median_depth,
            np.array([(lens.fx, lens.fy) for lens in lenses]),
            np.array([(lens.width, lens.height) for lens in lenses]) / 2.0,
            observations.median_depth,
        )

    def seen(self, pixel: Array, depth: Array, photo: NDArray[np.int64]) -> _Seen:
        """Of px [N, 2] and depths [N] in the cameras' unit."""
        x, y = ((pixel - self.half[photo]) / self.focal[photo]).T
        return _Seen(x, y, depth / self.middle, photo)

    def planes(self, distance: float, lean: Array, standing: bool) -> Array:
        """[V, 3] v of each camera."""
        first = np.array([*lean, 1.0]) / distance
        if not standing:
            return np.tile(first, (len(self.turn), 1))
        return np.asarray(np.einsum("nij,i->nj", self.turn, first) / (1.0 - self.moved @ first)[:, None])


@dataclass(frozen=True)
class _Question:
    """What a plane (distance, two leans, and the blur far behind it where no edges say that) leaves unexplained.

    Attributes:
        bands, scales, points: of the photos, what is left in each at best, and where its observations are seen.
        nearest: in middle depths; slope: exponent of the texture's power; standing: the kind of sheet.
        edges: where they are seen, and their widths [E] px; None where none say how wide a sheet blurs.
    """

    rig: _Rig
    bands: list[Band]
    scales: list[float]
    points: list[_Seen]
    nearest: float
    slope: float
    standing: bool
    edges: tuple[_Seen, Array] | None

    def asked_again(self, slope: float, standing: bool) -> _Question:
        """Of another texture, or another kind of sheet."""
        scales = [even_rest(band, slope) for band in self.bands]
        return replace(self, scales=scales, slope=slope, standing=standing)

    def planes(self, values: Array) -> Array:
        return self.rig.planes(float(values[0]), values[1:3], self.standing)

    def far(self, values: Array) -> float:
        """px, blur far behind the plane."""
        if self.edges is None:
            return float(values[3])
        seen, widths = self.edges
        return narrow(widths / np.maximum(seen.behind(self.planes(values)), SETTINGS.least_behind))

    def possible(self, values: Array) -> bool:
        """Whether the plane stands before all cameras, and before what they see."""
        if not SETTINGS.nearest < values[0] < 0.99 * self.nearest or np.abs(values[1:3]).max() > SETTINGS.steepest:
            return False
        if len(values) > 3 and values[3] <= 0.0:
            return False
        return not self.standing or bool((self.planes(values)[:, 2] > 0.0).all())

    def lost(self, values: Array) -> list[Array]:
        """Of each band [N], natural log of the power that is left."""
        planes, far = self.planes(values), self.far(values)
        each = zip(self.bands, self.points, strict=True)
        return [lost(band, (far * points.behind(planes)) ** 2, self.slope) for band, points in each]

    def costs(self, values: Array) -> Array:
        """[B] by region of space."""
        return left_over(self.bands, self.scales, self.lost(values))

    def cost(self, values: Array) -> float:
        """Of all; beyond all others where it is no plane."""
        return float(self.costs(values).sum()) if self.possible(values) else 1e12

    def texture(self, values: Array) -> float:
        """Exponent of the texture's power as the plane leaves it."""
        return texture_slope(self.bands, self.lost(values))


def glass_of(photos: PhotoSet) -> GlassShown | None:
    """By points, with the width that edges show where they show one: points alone hardly know it.

    Where a parallel sheet explains more than one right at the camera, one that leans and one that stands are tried.
    """
    edges = width_of_edges(photos)
    if edges is None:
        seen = glass_by_points(photos)
    else:
        seen = glass_by_points(photos, edges.width, edges.depth, edges.alone)
    alone = None if edges is None else edges.alone
    if seen is not None and alone is not None:
        seen = replace(seen, width_error=EDGES.off * seen.width)
    if seen is None or not seen.may_grow:
        return seen
    return replace(seen, plane=glass_plane(photos, seen, alone))


def glass_plane(photos: PhotoSet, parallel: GlassShown, alone: LoneWidths | None) -> GlassPlane | None:
    """The sheet that leans, or the one that stands, where it explains more than a parallel one, beyond chance."""
    asked = _asked(photos, parallel, alone)
    flat = _flat(asked, parallel)
    before = least = asked.costs(flat)
    picks, found = drawn_regions(len(before)), None
    for standing in (False, True):
        question, values = _found(asked, standing, flat)
        # (all by the scales and the texture of the parallel one)
        costs = replace(asked, standing=standing).costs(values)
        if Gain.over(least, costs, picks).errors > SETTINGS.sure:
            found, least = (question, values), costs
    if found is None:
        return None
    return _plane(*found, Gain.over(before, least, picks), Gain.over(parallel.even, least, picks))


def _asked(photos: PhotoSet, parallel: GlassShown, alone: LoneWidths | None) -> _Question:
    """What is asked of planes, of sheets that move with the camera first."""
    observations = photos.observations
    assert observations is not None
    rig, bands = _Rig.of(photos), photos.once(surface_bands)
    depth = observations.depth * observations.median_depth
    points = rig.seen(observations.pixel, depth, observations.photo)
    edges = None
    if alone is not None:
        names, at = list(rig.stands), alone.edges
        rows = np.array([names.index(photos.looked_at[i].name) for i in at.photo], np.int64)
        edges = rig.seen(np.stack([at.x, at.y], axis=1), alone.depths, rows), alone.widths
    each = [points.chosen(band.observation) for band in bands]
    scales = [even_rest(band, parallel.slope) for band in bands]
    return _Question(rig, bands, scales, each, parallel.nearest / parallel.middle, parallel.slope, False, edges)


def _flat(asked: _Question, parallel: GlassShown) -> Array:
    """The best parallel sheet, searched like the others."""
    middle = parallel.middle
    far = parallel.width / (1.0 - parallel.distance / middle)
    width = [] if asked.edges is not None else [far]
    best = minimize(
        lambda free: asked.cost(np.array([free[0], 0.0, 0.0, *free[1:]])),
        [parallel.distance / middle, *width],
        method="Nelder-Mead",
        options={"fatol": SETTINGS.done, "maxfev": SETTINGS.steps},
    ).x
    return np.array([best[0], 0.0, 0.0, *best[1:]])


def _found(asked: _Question, standing: bool, flat: Array) -> tuple[_Question, Array]:
    """The best plane of a kind, and the question with its texture."""
    question, values = asked.asked_again(asked.slope, standing), flat
    for _ in range(SETTINGS.rounds):
        starts = sorted(_starts(question, flat), key=question.cost)[: SETTINGS.searches]
        values = min((_searched(question, start) for start in starts), key=question.cost)
        question = question.asked_again(question.texture(values), standing)
    return question, values


def _starts(question: _Question, flat: Array) -> list[Array]:
    """Planes from which to search: the best parallel one of some, with all leans."""
    widths = [[]] if question.edges is not None else [[ratio * flat[3]] for ratio in SETTINGS.widths]
    tried = [np.array([share * question.nearest, 0.0, 0.0, *width]) for share in SETTINGS.distances for width in widths]
    best = min([flat, *tried], key=question.cost)
    return [np.array([best[0], right, down, *best[3:]]) for right in SETTINGS.leans for down in SETTINGS.leans]


def _searched(question: _Question, start: Array) -> Array:
    """The best plane near one."""
    near, lean, share = SETTINGS.first_step
    steps = np.array([near, lean, lean, share * start[3]] if len(start) > 3 else [near, lean, lean])
    corners = start + np.vstack([np.zeros(len(start)), np.diag(steps)])
    options = {"fatol": SETTINGS.done, "xatol": 1e-3, "maxfev": SETTINGS.steps, "initial_simplex": corners}
    return np.asarray(minimize(question.cost, start, method="Nelder-Mead", options=options).x)


def _plane(question: _Question, values: Array, over_parallel: Gain, over_even: Gain) -> GlassPlane:
    """A plane in the cameras' unit, with its errors."""
    errors, middle = _errors(question, values), question.rig.middle
    return GlassPlane(
        far=question.far(values),
        distance=float(values[0]) * middle,
        distance_error=float(errors[0]) * middle,
        lean=(float(values[1]), float(values[2])),
        lean_error=(float(errors[1]), float(errors[2])),
        standing=question.standing,
        over_parallel=over_parallel,
        over_even=over_even,
        stands=question.rig.stands if question.standing else None,
    )


def _errors(question: _Question, values: Array) -> Array:
    """Standard errors by how much gradients differ between regions of space (sandwich), by differences."""
    near, lean, share = SETTINGS.small
    steps = np.diag([near, lean, lean, share * values[3]] if len(values) > 3 else [near, lean, lean])
    size = np.diag(steps)
    gradients = np.array([(question.costs(values + s) - question.costs(values - s)) for s in steps]) / (
        2 * size[:, None]
    )
    bends = np.array(
        [
            [sum(i * j * question.costs(values + i * a + j * b).sum() for i in (1, -1) for j in (1, -1)) for b in steps]
            for a in steps
        ]
    ) / (4 * np.outer(size, size))
    inverse = np.linalg.pinv(bends)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ (gradients @ gradients.T) @ inverse.T), 0.0)))
