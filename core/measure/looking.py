"""Where a line of sight from anywhere meets the twin's surface, and which edge lies nearest there.

The twin is rendered as a small picture around the line, by a camera whose px are as large on the surface as those of
the photos. Edges and corners are found as Foerstner and Guelch do (1987): the point that the lines along all edges in a
window come nearest to, with gradients g and weights w,

    p = (sum w g g')^-1 sum w g g' x

and where all edges run one way, only the part of it across them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, minimum_filter

from ..camera import Camera
from ..errors import DgsError
from ..forward import low_pass_on_grid, sharp_depths, sharp_view
from ..gaussians import Gaussians
from ..mesh.surfaces import SURFACE
from ..numbers import number
from ..rasterizer import RasterSettings
from .places import PRECISION, seen_by, surface_depth
from .sights import Sight, Sights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LookSettings:
    """Of the small picture, and of edges in it; px are those of the photos on the surface."""

    side: int = number(33, "px", "of the picture around a line of sight")
    window: float = number(1.5, "px", "standard deviation of the weights about a place, in which edges are looked for")
    gradient: float = number(
        1.0, "px", "standard deviation of the derivative of a Gaussian that gradients are taken by"
    )
    farthest: float = number(4.0, "px", "that an edge may lie off; one that is farther off was not meant")
    faintest: float = number(0.01, "sRGB per px", "of an edge's gradient, in the mean of the window")
    corner: float = number(0.15, "share", "of the stronger eigenvalue that the weaker one has at a corner, at least")
    rounds: int = number(5, "count", "of the search, each about the place that the last one found")


LOOK = LookSettings()


def seen_along(views: Sights, origin: Array, towards: Array, edges: bool) -> tuple[Sight, tuple[float, float]] | None:
    """A small picture around a line of sight, and the place in it (px) that is meant.

    Args:
        origin, towards: [3] two points of the line, the scene's own units.
        edges: whether the nearest edge is meant, if one is near.

    Returns:
        None where the line meets nothing.

    Raises:
        DgsError: these sights hold no Gaussians.
    """
    if views.gaussians is None:
        raise DgsError("Lines of sight need the twin's Gaussians")
    focal = float(np.median([sight.camera.fx for sight in views.views.values()]))
    middle = LOOK.side / 2
    first = _pictured(views.gaussians, _aimed(origin, towards, focal), image=False)
    depth = surface_depth(first, middle, middle)
    if not np.isfinite(depth):
        return None
    position = first.camera.centre + depth * first.camera.rotation[2]
    sight = _pictured(views.gaussians, _aimed(origin, towards, depth / px_of_photos(views, position)), image=True)
    if edges:
        moved, sharp = nearest_edge(sight.image), _foreground(sight)
        if np.isfinite(surface_depth(sharp, *moved)):
            return sharp, moved
    return (sight, (middle, middle)) if np.isfinite(surface_depth(sight, middle, middle)) else None


def px_of_photos(views: Sights, position: Array) -> float:
    """Size of a px of the photos at a position: the median of those that see it, or of all if none does."""
    sizes, seen = list[float](), list[float]()
    for sight in views.views.values():
        camera = sight.camera
        size = abs(float(camera.rotation[2] @ position + camera.translation[2])) / camera.fx
        (sizes if seen_by(sight, position) is None else seen).append(size)
    return float(np.median(seen or sizes))


def nearest_edge(image: NDArray[np.float32]) -> tuple[float, float]:
    """The edge or corner that is nearest to the middle of a picture [3, N, N]; the middle where there is none near."""
    middle = np.full(2, LOOK.side / 2)
    found = middle
    gy, gx = (gaussian_filter(image.astype(np.float64), LOOK.gradient, order=order, axes=(1, 2)) for order in _ORDERS)
    y, x = np.meshgrid(np.arange(LOOK.side) + 0.5, np.arange(LOOK.side) + 0.5, indexing="ij")
    products = np.stack([(gx * gx).sum(axis=0), (gx * gy).sum(axis=0), (gy * gy).sum(axis=0)])
    for _ in range(LOOK.rounds):
        weight = np.exp(-((x - found[0]) ** 2 + (y - found[1]) ** 2) / (2 * LOOK.window**2))
        xx, xy, yy = (products * weight).sum(axis=(1, 2))
        off_x, off_y = x - found[0], y - found[1]
        moment = [
            (weight * (products[0] * off_x + products[1] * off_y)).sum(),
            (weight * (products[1] * off_x + products[2] * off_y)).sum(),
        ]
        sizes, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        if sizes[1] < LOOK.faintest**2 * weight.sum():
            return float(middle[0]), float(middle[1])
        kept = sizes > LOOK.corner * sizes[1]
        found = found + axes[:, kept] @ ((axes[:, kept].T @ moment) / sizes[kept])
        if np.linalg.norm(found - middle) > LOOK.farthest:
            return float(middle[0]), float(middle[1])
    return float(found[0]), float(found[1])


#: Of derivatives along y and along x.
_ORDERS = ((1, 0), (0, 1))


def _aimed(origin: Array, towards: Array, focal: float) -> Camera:
    """A camera at a point that looks at another one."""
    forward = (towards - origin) / np.linalg.norm(towards - origin)
    aside = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    right = aside / np.linalg.norm(aside)
    rotation = np.stack([right, np.cross(forward, right), forward])
    middle = LOOK.side / 2
    return Camera("look", LOOK.side, LOOK.side, focal, focal, middle, middle, rotation, -rotation @ origin)


def _pictured(gaussians: Gaussians, camera: Camera, *, image: bool) -> Sight:
    drawn = RasterSettings(low_pass=low_pass_on_grid(1))
    depths = sharp_depths(gaussians, camera, drawn, held=SURFACE.held)
    depth = np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan).astype(np.float32)
    empty = np.zeros((3, LOOK.side, LOOK.side), np.float32)
    seen = sharp_view(gaussians, camera, drawn).image.numpy() if image else empty
    return Sight(camera, depth, empty, seen)


def _foreground(sight: Sight) -> Sight:
    """Depths that what is in front has a px farther out: an edge belongs to it."""
    depth = np.where(np.isfinite(sight.depth), sight.depth, np.inf)
    front = minimum_filter(depth, 3)
    with np.errstate(invalid="ignore"):
        beside = depth - front > PRECISION.own * front / sight.camera.fx
    return replace(sight, depth=np.where(beside & np.isfinite(front), front, sight.depth).astype(np.float32))
