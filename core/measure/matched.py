"""The depth of a place that the twin's pictures agree on, rather than that of its splats.

Behind a blur splats stand in layers before the surface that show every photo as it is (see `core.mesh.matching`): where
they hold back the light, all cameras' depths are off alike. What the cameras see of the twin is right nevertheless. So
the picture around a place is compared with what the other cameras see there, for a small plane at each of many depths
along its ray; depth and slope of the best one are refined between px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from ..camera import Camera
from ..numbers import number
from .matched_kernels import plane_correlations
from .rays import inside, projected, ray
from .sights import Sight, Sights

Array = NDArray[np.float64]

_CHOSEN = "corners of the rendered shelf and orrery, balanced twins, sharp and through 5 px"
_CHECKED = "corners of the rugby ball and the village, which were looked at on the way"
_FIRST = "the first and only value"


@dataclass(frozen=True)
class DepthMatchSettings:
    """Of the comparison; px are px-equivalents along the ray: depth over focal length."""

    reach: float = number(
        12.0, "px", "that a surface may lie off the splats' depth; 20 find the same places", _CHOSEN, _CHECKED
    )
    step: float = number(0.5, "px", "between depths that are tried", _FIRST)
    radius: int = number(
        4, "px", "windows of (2 radius + 1)^2 px are compared; 3 and 5 are as exact in the mean", _CHOSEN, _CHECKED
    )
    angle: float = number(
        40.0, "deg", "from the ray, beyond which other cameras do not count; 60 are the same", _CHOSEN, _CHECKED
    )
    texture: float = number(
        0.004, "share of white", "standard deviation of a window below which it shows nothing", "as of MATCHING"
    )
    faint: float = number(0.0022, "share of white", "that lowers the correlation of windows that show little", _FIRST)
    slope: float = number(0.005, "correlation", "that a slope of 1 px per px costs: planes face the camera", _FIRST)
    steepest: float = number(0.5, "share", "of its depth that a plane may come nearer within the window", _FIRST)
    window: float = number(0.5, "share", "of a window that must lie on the place's own surface", _FIRST)
    least: float = number(
        0.2, "correlation", "of a camera's own best depth, without which it is none", "as of MATCHING"
    )
    agreeing: float = number(1.0, "px", "within which a camera's own best depth is the place's", "as of MATCHING")
    witnesses: int = number(3, "cameras", "that must agree", "as of MATCHING")
    rounds: int = number(150, "count", "of the search for depth and slope, at most", _FIRST)
    settled: float = number(1e-3, "px", "of depth, and of slope, that the search ends within", _FIRST)


SETTINGS = DepthMatchSettings()


@dataclass(frozen=True)
class MatchedDepth:
    """What was found.

    Attributes:
        depth: along the camera's axis, the scene's own units.
        moved: px from the splats' depth.
    """

    depth: float
    moved: float


@dataclass(frozen=True)
class _Window:
    """A reference camera's window and the cameras that it is compared with.

    Attributes:
        camera: of the reference; own: depth of its splats in the middle.
        pixels: [n, 2] of the window's samples; off: [n, 2] px from the middle.
        values: [n] what it shows, of mean 0 and length 1.
        others: whose pictures are compared.
    """

    camera: Camera
    own: float
    pixels: Array = field(repr=False)
    off: Array = field(repr=False)
    values: Array = field(repr=False)
    others: Sequence[Sight] = field(repr=False)

    @cached_property
    def _turns(self) -> list[tuple[Array, Array]]:
        """Of each other camera: px of the window, times depth, to its own."""
        found = []
        for other in self.others:
            lens = _lens(other.camera) @ other.camera.rotation
            turn = lens @ self.camera.rotation.T @ np.linalg.inv(_lens(self.camera))
            centre = (
                other.camera.rotation.T @ other.camera.translation - self.camera.rotation.T @ self.camera.translation
            )
            found.append((np.ascontiguousarray(turn), lens @ centre))
        return found

    def correlations(self, depths: Array, slope: Array, settings: DepthMatchSettings) -> Array:
        """[K, D] correlation with each other camera if a plane of this slope [2] (px per px) lies at each depth [D];
        -1 where that is outside its photo."""
        nearer = np.clip(self.off @ slope / self.camera.fx, -settings.steepest, settings.steepest)
        found = np.empty((len(self.others), len(depths)))
        x, y = self.pixels.T.copy()
        faint = settings.faint * len(x) ** 0.5
        for other, (turn, shift), out in zip(self.others, self._turns, found, strict=True):
            plane_correlations(0, len(depths), depths, other.grey, turn, shift, x, y, nearer, self.values, faint, out)
        return found


def _lens(camera: Camera) -> Array:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def matched_depth(
    views: Sights, sight: Sight, x: float, y: float, own: float, settings: DepthMatchSettings = SETTINGS
) -> MatchedDepth | None:
    """The depth that most cameras agree on.

    Args:
        sight: of the camera that a place is given in; x, y: the place, px.
        own: depth of its splats there.

    Returns:
        None where the twin's pictures show too little, or too few cameras agree.
    """
    window = _window(views, sight, x, y, own, settings)
    if window is None or not window.others:
        return None
    px = own / sight.camera.fx
    offsets = np.arange(-settings.reach, settings.reach + settings.step / 2, settings.step)
    depths = own + offsets * px
    first = float(offsets[np.argmax(_together(window.correlations(depths, np.zeros(2), settings)))])

    def cost(guess: Array) -> float:
        correlations = window.correlations(np.array([own + guess[0] * px]), guess[1:], settings)
        return settings.slope * float(guess[1:] @ guess[1:]) - float(_together(correlations)[0])

    simplex = np.array([first, 0.0, 0.0]) + np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.3]])
    # (correlations differ by 1e-9 where depths differ by a thousandth of a px)
    options = {"initial_simplex": simplex, "maxiter": settings.rounds, "xatol": settings.settled, "fatol": 1e-9}
    best = minimize(cost, simplex[0], method="Nelder-Mead", options=options).x
    moved = float(best[0])
    if abs(moved) > settings.reach:
        return None
    each = window.correlations(depths, best[1:], settings)
    there = np.abs(offsets[np.argmax(each, axis=1)] - moved) <= settings.agreeing + settings.step / 2
    if (there & (each.max(axis=1) > settings.least)).sum() < settings.witnesses:
        return None
    return MatchedDepth(own + moved * px, abs(moved))


def _together(correlations: Array) -> Array:
    """[D] mean over the better half of the cameras [K, D]: where some are occluded, the others decide."""
    half = (len(correlations) + 1) // 2
    return np.asarray(np.sort(correlations, axis=0)[-half:].mean(axis=0))


def _window(
    views: Sights, sight: Sight, x: float, y: float, own: float, settings: DepthMatchSettings
) -> _Window | None:
    """The picture around a place, without what lies on another side of a step; None where it shows nothing."""
    camera, reach = sight.camera, settings.reach * own / sight.camera.fx
    side = np.arange(-settings.radius, settings.radius + 1.0)
    off = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    pixels = off + (x, y)
    there = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    columns, rows = np.clip(pixels.astype(int), 0, (camera.width - 1, camera.height - 1)).T
    kept = there & (np.abs(sight.depth[rows, columns] - own) < reach)
    if kept.mean() < settings.window:
        return None
    at = pixels[kept]
    values = map_coordinates(sight.grey, (at[:, 1] - 0.5, at[:, 0] - 0.5), np.float64, order=1, mode="nearest")
    values = values - values.mean()
    if values.std() < settings.texture:
        return None
    position = camera.centre + ray(camera, x, y) * own
    others = [one for one in views.views.values() if one.trained and _looks(one, sight, position, settings)]
    return _Window(camera, own, at, off[kept], values / np.linalg.norm(values), others)


def _looks(other: Sight, sight: Sight, position: Array, settings: DepthMatchSettings) -> bool:
    """Whether another camera looks at a place from about the same side, and nothing stands before it."""
    camera, edge = other.camera, settings.radius
    x, y = projected(camera, position)
    if camera.name == sight.camera.name or not inside(camera, x - edge, y - edge):
        return False
    if not inside(camera, x + edge, y + edge):
        return False
    ways = [position - sight.camera.centre, position - camera.centre]
    cosine = float(ways[0] @ ways[1]) / float(np.linalg.norm(ways[0]) * np.linalg.norm(ways[1]))
    before = float(other.depth[int(y), int(x)])
    behind = float(camera.rotation[2] @ position + camera.translation[2]) - before
    return cosine > np.cos(np.radians(settings.angle)) and behind < settings.reach * before / camera.fx
