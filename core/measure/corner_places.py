"""Where rays to a print's corners meet: px of the photos, without those that are another corner's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DgsError
from ..numbers import number
from .located import met
from .markers import CHESS, Corner, FoundCorners
from .places import SurfacePoint
from .rays import projected
from .request import Point
from .sights import Sights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CornerSettings:
    """Of corners that several photos show."""

    sure: float = number(0.05, "px", "least standard deviation of a corner on a photo")
    outlier: float = number(4.0, "times the others' median", "beyond which a corner on a photo is another's")
    farthest: float = number(5.0, "px", "beyond which it always is, however little the others agree")
    off: float = number(0.75, "px", "within which a corner on a photo is never taken for another's")


SETTINGS = CornerSettings()


def marks_of(seen: Mapping[str, FoundCorners]) -> dict[Corner, dict[str, Point]]:
    """Photos and px of each corner, without what black reaches too far everywhere."""
    marks = dict[Corner, dict[str, Point]]()
    measured = [px for found in seen.values() for px in found.spread.values()]
    spread = float(np.median(measured)) if measured else 0.0
    for photo, found in seen.items():
        for (marker, index), point in found.corners.items():
            at = point if marker == CHESS else _drawn_in(found.corners, marker, index, spread)
            marks.setdefault((marker, index), {})[photo] = at
    return marks


def _drawn_in(corners: Mapping[Corner, Point], marker: int, index: int, by: float) -> Point:
    """A marker's corner where both its sides lie `by` px farther inside."""
    at, before, after = (np.array(corners[marker, (index + step) % 4]) for step in (0, -1, 1))
    ways = [(other - at) / np.linalg.norm(other - at) for other in (before, after)]
    sine = abs(float(ways[0][0] * ways[1][1] - ways[0][1] * ways[1][0]))
    x, y = at + by * (ways[0] + ways[1]) / sine
    return float(x), float(y)


def placed(
    marks: Mapping[Corner, dict[str, Point]], views: Sights, cameras: float
) -> tuple[dict[Corner, SurfacePoint], float, int]:
    """Where rays to each corner meet, rms of px about it, and how many points of photos were left out."""
    kept = dict[Corner, tuple[dict[str, Point], Array]]()
    for corner, points in marks.items():
        agreed = _agreeing(points, views)
        if agreed is not None:
            kept[corner] = agreed
    squares = [float((residuals**2).sum()) for _, residuals in kept.values()]
    freedom = sum(residuals.size - 3 for _, residuals in kept.values())
    rms = float(np.sqrt(sum(squares) / max(1, freedom)))
    across = float(np.hypot(max(rms, SETTINGS.sure), cameras))
    places = {corner: met(_called(corner), views, points, across) for corner, (points, _) in kept.items()}
    dropped = sum(len(points) for points in marks.values()) - sum(len(points) for points, _ in kept.values())
    return places, rms, dropped


def _agreeing(points: dict[str, Point], views: Sights) -> tuple[dict[str, Point], Array] | None:
    """The points whose rays meet, and [n, 2] px that they are off by; None where fewer than two, or than half, do."""
    left = dict(points)
    while len(left) > 1 and 2 * len(left) >= len(points):
        off = _off(left, left, views)
        if off is None:
            return None
        sizes = np.linalg.norm(off, axis=1)
        worst = list(left)[int(sizes.argmax())]
        others = {photo: at for photo, at in left.items() if photo != worst}
        if sizes.max() <= SETTINGS.off and len(others) == 1:
            return left, off
        # a wild point draws the place towards itself: it is held against where the others' rays meet
        rest = None if len(others) == 1 else _off(others, left, views)
        if rest is not None:
            alone = {photo: float(size) for photo, size in zip(left, np.linalg.norm(rest, axis=1), strict=True)}
            usual = float(np.median([alone[photo] for photo in others]))
            if alone[worst] <= max(SETTINGS.off, min(SETTINGS.outlier * usual, SETTINGS.farthest)):
                return left, off
        left = others
    return None


def _off(points: dict[str, Point], asked: Mapping[str, Point], views: Sights) -> Array | None:
    """[n, 2] px from the points that are asked for to where the rays of `points` meet; None where they do not."""
    try:
        place = met("a corner", views, points, SETTINGS.sure).position
    except DgsError:
        return None
    return np.array([np.subtract(projected(views.views[photo].camera, place), at) for photo, at in asked.items()])


def _called(corner: Corner) -> str:
    return (
        f"corner {corner[1]} of the chessboard" if corner[0] == CHESS else f"corner {corner[1]} of marker {corner[0]}"
    )
