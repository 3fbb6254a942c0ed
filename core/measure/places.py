"""Places on a twin's surface, and how sure they are.

A place is given as a point of a photo: its ray meets the surface at a depth. Errors across the ray come from where the
point was set, errors along it from the twin. How well photos hold the depth follows from what they show there
*through the blur*: moved along the ray by dz, the surface's picture moves by v_j dz in photo j, against the photo's
own gradients g, which the blur has weakened. With noise s and G_j = sum g g' over a window,

    1 / var(z) = (sum_j v_j' G_j v_j  -  (sum_j G_j v_j)' (sum_j G_j)^-1 (sum_j G_j v_j)) / s^2

(Cramer and Rao; the second term is what a shift of the surface's texture can make up for). That is the least that any
method could reach with this texture known. A twin does not know it, its residuals hang together, and its surface is as
stiff as its splats: its errors are larger by a factor that was measured. Where it shows what was never there (gloss,
steps in depth), its cameras see its surface in different depths: their disagreement is the second part.

Where the twin's pictures agree on a depth (`core.measure.matched`), that is taken, and the bound counts for little:
how far it lies from the splats' own depth, and the blur, say how wrong it may be.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..numbers import number
from .matched import MatchedDepth
from .rays import inside, projected
from .sights import Sight, Sights

Array = NDArray[np.float64]


#: What the numbers of places that pictures agree on were chosen on and checked by.
_MATCHED = (
    "depths of corners of the rendered shelf and orrery, through 0, 2, 3 and 5 px: 92 to 97 % of six sets",
    "lengths of eight other sets, blurred by 1 to 8 px: 93 % of 3754 held (benchmarks/measured.json)",
)


@dataclass(frozen=True)
class PrecisionSettings:
    """How the parts of a depth's variance are weighed; px are px-equivalents: depth over focal length."""

    photos: float = number(
        40.0,
        "factor",
        "of the least standard deviation that photos allow: what a twin reaches; with 30, 2 % fewer intervals hold",
        "lengths between corners of the rendered shelf (blurred by 3 and 5 px) and orrery (0, 2, 5 px): 91 to 97 %",
        "seven other sets, blurred by 1 to 8 px: 91 % of 274 lengths held, when all places were of this kind",
    )
    disagreement: float = number(
        1.0,
        "factor",
        "of the robust standard deviation of the cameras' surfaces about this one; without it 48 to 89 % held on the"
        " glossy orrery. Steps nearby and the spread of the light along the ray were tried as further parts and made"
        " no interval narrower",
        "as of photos",
        "as of photos",
    )
    least_matched: float = number(
        2.0, "factor", "of the least standard deviation, of a place that the twin's pictures agree on", *_MATCHED
    )
    moved: float = number(
        1.2,
        "factor",
        "of how far such a place lies from the splats' own depth: reflections seem to lie behind what is glossy",
        *_MATCHED,
    )
    blurred: float = number(0.46, "px per px of blur", "standard deviation of such a place's depth", *_MATCHED)
    floor_matched: float = number(
        1.1,
        "px",
        "the same where nothing else is wrong. The spread of the cameras' own best depths, how many agree, and the"
        " slope of the surface were tried as further parts, and made intervals no narrower",
        *_MATCHED,
    )
    floor: float = number(
        0.3, "px", "standard deviation of a depth where everything else is perfect", "as of photos", "as of photos"
    )
    own: float = number(5.0, "px", "within which a camera's surface is the same as this one, not another before it")
    window: int = number(5, "px", "side of the window in which a plane is fitted to the surface")
    click: float = number(0.3, "px", "standard deviation of a place set by hand, where none is given")
    snap: float = number(5.0, "px", "within which a position in space is taken for the surface before it")
    most: float = number(50.0, "px", "least standard deviation that photos allow, where none holds a depth at all")


PRECISION = PrecisionSettings()


@dataclass(frozen=True)
class SurfacePoint:
    """A place on the surface, in the scene's own units.

    Attributes:
        position: [3].
        covariance: [3, 3].
        pixel: size of a px there.
        seen: photos that hold it.
        reach: px within which what a camera sees is this place.
    """

    position: Array = field(repr=False)
    covariance: Array = field(repr=False)
    pixel: float
    seen: int
    reach: float = PRECISION.own


def surface_depth(sight: Sight, x: float, y: float, window: int = PRECISION.window) -> float:
    """Depth of the surface at a point of a photo (px): of a plane through its window, but for what is on another side
    of a step; NaN where there is none."""
    column, row, reach = int(np.floor(x)), int(np.floor(y)), window // 2
    camera = sight.camera
    if not (0 <= column < camera.width and 0 <= row < camera.height) or not np.isfinite(sight.depth[row, column]):
        return float("nan")
    rows = np.arange(max(0, row - reach), min(camera.height, row + reach + 1))
    columns = np.arange(max(0, column - reach), min(camera.width, column + reach + 1))
    around = sight.depth[np.ix_(rows, columns)].astype(np.float64)
    middle = float(sight.depth[row, column])
    dy, dx = np.meshgrid(rows + 0.5 - y, columns + 0.5 - x, indexing="ij")
    pixel = middle / camera.fx
    near = np.isfinite(around) & (np.abs(around - middle) < PRECISION.own * pixel)
    # 1 / z is linear in the picture where the surface is a plane
    equations = np.stack([np.ones(int(near.sum())), dx[near], dy[near]], axis=1)
    if len(equations) < 6 or np.linalg.matrix_rank(equations) < 3:
        return middle
    inverse = np.linalg.lstsq(equations, 1.0 / around[near], rcond=None)[0][0]
    return float(np.clip(1.0 / inverse, around[near].min(), around[near].max())) if inverse > 0 else middle


def deviation_of_depth(
    views: Sights, camera: Camera, position: Array, matched: MatchedDepth | None = None
) -> tuple[float, int]:
    """Standard deviation of a place's depth along the ray from `camera`, px-equivalents; how many photos hold it.

    Args:
        matched: what the twin's pictures agree on there; None for a place on the splats themselves.
    """
    least, offsets = _least_deviation(views, camera, position, reach_of(matched))
    if matched is not None:
        rest = (PRECISION.moved * matched.moved, PRECISION.blurred * views.blur, PRECISION.floor_matched)
        return float(np.linalg.norm([PRECISION.least_matched * least, *rest])), len(offsets)
    disagreement = 1.4826 * float(np.median(np.abs(offsets))) if offsets else 0.0
    parts = (PRECISION.photos * least, PRECISION.disagreement * disagreement, PRECISION.floor)
    return float(np.linalg.norm(parts)), len(offsets)


def reach_of(matched: MatchedDepth | None) -> float:
    """px within which a camera's splats are those of a place, not of what is before or behind it."""
    return PRECISION.own + (0.0 if matched is None else matched.moved)


def _least_deviation(views: Sights, camera: Camera, position: Array, reach: float) -> tuple[float, list[float]]:
    """What photos allow (px-equivalents), and how far behind the place each camera's splats lie (its px)."""
    depth = float((camera.rotation @ position + camera.translation)[2])
    pixel, way = depth / camera.fx, (position - camera.centre) / depth
    whole, turned, bent, offsets = np.zeros((2, 2)), np.zeros(2), 0.0, list[float]()
    for other in views.views.values():
        found = _looked_at(other, position, way, reach) if other.trained else None
        if found is None:
            continue
        shift, tensor = found[1] * pixel, found[2]  # px of the photo for each px-equivalent of depth
        whole, turned, bent = whole + tensor, turned + tensor @ shift, bent + float(shift @ tensor @ shift)
        offsets.append(found[0])
    least = PRECISION.most
    if len(offsets) > 1:
        regular = whole + (1e-6 * float(np.trace(whole)) + 1e-12) * np.eye(2)
        information = (bent - float(turned @ np.linalg.solve(regular, turned))) / views.noise**2
        least = min(least, max(information, 1e-12) ** -0.5)
    return least, offsets


def seen_by(sight: Sight, position: Array, reach: float = PRECISION.own) -> tuple[float, float] | None:
    """Where a camera sees a position, px; None where it lies outside the photo or farther than `reach` px (along its
    axis) from what it sees."""
    camera = sight.camera
    z = float(camera.rotation[2] @ position + camera.translation[2])
    u, v = projected(camera, position)
    if not inside(camera, u, v):
        return None
    near = abs(float(sight.depth[int(v), int(u)]) - z) < reach * z / camera.fx
    return (u, v) if near else None


def _looked_at(sight: Sight, position: Array, way: Array, reach: float) -> tuple[float, Array, Array] | None:
    """How far behind a position a camera's surface lies (its px), [2] px that the position moves by along `way` in the
    photo, and G; None where the camera does not see it."""
    camera = sight.camera
    x, y, z = camera.rotation @ position + camera.translation
    u, v = projected(camera, position)
    if not inside(camera, u, v):
        return None
    offset = (float(sight.depth[int(v), int(u)]) - z) / (z / camera.fx)
    if not abs(offset) < reach:
        return None
    a, b, c = camera.rotation @ way
    shift = np.array([camera.fx * (a - x / z * c) / z, camera.fy * (b - y / z * c) / z])
    xx, xy, yy = sight.tensor[:, int(v), int(u)].astype(np.float64)
    return float(offset), shift, np.array([[xx, xy], [xy, yy]])
