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
from ..imaging.formation.stands import middle_of, stands_between
from ..numbers import NOT_CHECKED, number
from .edge_depth import EdgeWidth, width_of_edges
from .glass_by_points import GlassPlane, GlassShown, cauchy, drawn_regions, even_rest, glass_by_points, lost, narrow
from .surface_bands import Band, surface_bands, texture_slope

if TYPE_CHECKING:
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
        plane = planes[self.photo]
        nearness = plane[:, 0] * self.x + plane[:, 1] * self.y + plane[:, 2]
        met = np.maximum(nearness, GLASS.grazing * np.abs(plane[:, 2]))
        tangent2 = self.x**2 + self.y**2
        cosine = met / np.sqrt((plane**2).sum(axis=1) * (1.0 + tangent2))
        wider = oblique(tangent2, np.clip(cosine, SETTINGS.seen_along, 1.0))
        return np.asarray(np.clip(1.0 - 1.0 / (met * self.depth), 0.0, None) * wider)


@dataclass(frozen=True)
class _Rig:
    """The cameras, lengths in middle depths: turn [V, 3, 3] and moved [V, 3] into the middle camera's axes."""

    names: tuple[str, ...]
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
        first = poses[middle_of(np.array([pose.centre for pose in poses]))]
        return cls(
            observations.names,
            np.array([first.rotation @ pose.rotation.T for pose in poses]),
            np.array([first.rotation @ (pose.centre - first.centre) for pose in poses]) / observations.median_depth,
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
            return np.tile(first, (len(self.names), 1))
        return np.asarray(np.einsum("nij,i->nj", self.turn, first) / (1.0 - self.moved @ first)[:, None])


@dataclass(frozen=True)
class _Question:
    """What a plane (distance, two leans, and the blur far behind it where no edges say that) leaves unexplained."""

    rig: _Rig
    bands: list[Band]
    scales: list[float]
    points: list[_Seen]
    nearest: float
    slope: float
    standing: bool
    edges: _Seen | None
    widths: Array | None

    def asked_again(self, slope: float, standing: bool) -> _Question:
        """Of another texture, or another kind of sheet."""
        scales = [even_rest(band, slope) for band in self.bands]
        return replace(self, scales=scales, slope=slope, standing=standing)

    def planes(self, values: Array) -> Array:
        return self.rig.planes(float(values[0]), values[1:3], self.standing)

    def far(self, values: Array) -> float:
        """px, blur far behind the plane."""
        if self.edges is None or self.widths is None:
            return float(values[3])
        behind = np.maximum(self.edges.behind(self.planes(values)), SETTINGS.least_behind)
        return narrow(self.widths / behind)

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
        blocks = 1 + max(int(band.block.max()) for band in self.bands)
        total = np.zeros(blocks)
        for band, scale, less in zip(self.bands, self.scales, self.lost(values), strict=True):
            total += np.bincount(band.block, cauchy(band.unexplained(less), scale), blocks)
        return total

    def cost(self, values: Array) -> float:
        """Of all; beyond all others where it is no plane."""
        return float(self.costs(values).sum()) if self.possible(values) else 1e12

    def texture(self, values: Array) -> float:
        """Exponent of the texture's power as the plane leaves it."""
        return texture_slope(self.bands, self.lost(values))


def glass_of(photos: PhotoSet) -> GlassShown | None:
    """By points, with the width that edges show where they show one: points alone hardly know it.

    Where a parallel sheet explains more than an even blur, one that leans and one that stands are tried.
    """
    edges = width_of_edges(photos)
    if edges is None:
        seen = glass_by_points(photos)
    else:
        alone = None if edges.depths is None or edges.on_axis is None else (edges.on_axis, edges.depths)
        seen = glass_by_points(photos, edges.width, edges.depth, alone)
        seen = None if seen is None else replace(seen, width_error=edges.off * seen.width)
    if seen is None or not seen.better_than_even:
        return seen
    plane = glass_plane(photos, seen, edges)
    if plane is not None and plane.standing and photos.cameras is not None:
        plane = replace(plane, stands=stands_between(photos.cameras.poses))
    return replace(seen, plane=plane)


def glass_plane(photos: PhotoSet, parallel: GlassShown, edges: EdgeWidth | None) -> GlassPlane | None:
    """The sheet that leans, or the one that stands, where it explains more than a parallel one, beyond chance."""
    asked = _asked(photos, parallel, edges)
    flat = _flat(asked, parallel)
    leaning = asked.costs(flat)
    found = None
    for standing in (False, True):
        question, values = _found(asked, standing, flat)
        gained = leaning - _comparable(question, asked).costs(values)
        error = _spread(gained)
        if gained.sum() > SETTINGS.sure * error:
            found = _plane(question, values, float(gained.sum()) + (0.0 if found is None else found.gain), error)
            leaning = leaning - gained
    return found


def _comparable(question: _Question, asked: _Question) -> _Question:
    """The same plane's question by the scales and the texture of another."""
    return replace(asked, standing=question.standing)


def _asked(photos: PhotoSet, parallel: GlassShown, edges: EdgeWidth | None) -> _Question:
    """What is asked of planes, of sheets that move with the camera first."""
    observations = photos.observations
    assert observations is not None
    rig, bands = _Rig.of(photos), surface_bands(photos)
    depth = observations.depth * observations.median_depth
    points = rig.seen(observations.pixel, depth, observations.photo)
    places = widths = None
    if edges is not None and edges.alone is not None and edges.depths is not None:
        rows = np.array([rig.names.index(photos.looked_at[i].name) for i in edges.alone.photo], np.int64)
        places = rig.seen(np.stack([edges.alone.x, edges.alone.y], axis=1), edges.depths, rows)
        widths = edges.widths
    each = [points.chosen(band.observation) for band in bands]
    scales = [even_rest(band, parallel.slope) for band in bands]
    nearest = parallel.nearest / parallel.middle
    return _Question(rig, bands, scales, each, nearest, parallel.slope, False, places, widths)


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


def _spread(gained: Array) -> float:
    """Standard error of a sum over regions of space."""
    return float((drawn_regions(len(gained)) @ gained).std())


def _plane(question: _Question, values: Array, gain: float, error: float) -> GlassPlane:
    """A plane in the cameras' unit, with its errors."""
    errors, middle = _errors(question, values), question.rig.middle
    return GlassPlane(
        far=question.far(values),
        distance=float(values[0]) * middle,
        distance_error=float(errors[0]) * middle,
        lean=(float(values[1]), float(values[2])),
        lean_error=(float(errors[1]), float(errors[2])),
        standing=question.standing,
        gain=gain,
        gain_error=error,
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
