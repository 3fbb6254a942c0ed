"""Which views are swept, and with which others each is compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from .stack import Floats, ViewStack

#: Rows and columns of the grid of px by which the overlap of two views is judged.
_GRID = 5


@dataclass(frozen=True)
class ChoiceSettings:
    """Of the views that are swept, and of their neighbours."""

    references: int = number(
        32,
        "count",
        "views that are swept, evenly chosen; more take longer and show less that is new",
        FIRST_TRIED,
        LOOKED_AT,
    )
    turned: float = number(
        0.5,
        "spreads of the cameras",
        "that opposite directions of sight count for, when views are chosen evenly",
        FIRST_TRIED,
        LOOKED_AT,
    )
    neighbours: int = number(
        4, "count", "views that each is compared with; the better half decides", FIRST_TRIED, LOOKED_AT
    )
    angle: float = number(
        12.0,
        "degrees",
        "between the rays to a neighbour and to the view: less shows no depth, more another sight",
        FIRST_TRIED,
        LOOKED_AT,
    )
    smallest_angle: float = number(3.0, "degrees", "a neighbour has at least, if any has", FIRST_TRIED, LOOKED_AT)
    largest_angle: float = number(32.0, "degrees", "a neighbour has at most, if any has", FIRST_TRIED, LOOKED_AT)
    overlap: float = number(0.25, "share", "of the view that a neighbour must see", FIRST_TRIED, LOOKED_AT)
    closer: float = number(
        2.0,
        "ratio",
        "of distances to the scene, beyond which a px of one is no px of the other",
        FIRST_TRIED,
        LOOKED_AT,
    )


SETTINGS = ChoiceSettings()


def chosen_references(views: ViewStack, settings: ChoiceSettings = SETTINGS, count: int | None = None) -> list[int]:
    """Indices of views far from one another in place and direction: each next one is the farthest from all before.

    Args:
        count: how many; None for as many as are swept.
    """
    count = settings.references if count is None else count
    return spread_poses(views.centres, views.rotations[:, 2], count, settings)


def spread_poses(centres: Floats, axes: Floats, count: int, settings: ChoiceSettings = SETTINGS) -> list[int]:
    """As `chosen_references`, of cameras at `centres` [V, 3] that look along `axes` [V, 3]."""
    if len(centres) <= count:
        return list(range(len(centres)))
    where = _posed(centres, axes, settings)
    chosen = [0]
    distance = np.full(len(centres), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, ((where - where[chosen[-1]]) ** 2).sum(1))
        chosen.append(int(distance.argmax()))
    return sorted(chosen)


def most_alike(
    view: int, among: Sequence[int], views: ViewStack, count: int, settings: ChoiceSettings = SETTINGS
) -> list[int]:
    """Which of the views `among` (positions in it, at most `count`) are nearest to a view in place and direction."""
    where = _posed(views.centres, views.rotations[:, 2], settings)
    distance = ((where[list(among)] - where[view]) ** 2).sum(1)
    return [int(index) for index in np.argsort(distance, kind="stable")[:count]]


def _posed(centres: Floats, axes: Floats, settings: ChoiceSettings) -> Floats:
    """[V, 6] places and directions in one measure."""
    spread = float(np.sqrt(((centres - centres.mean(0)) ** 2).sum(1).mean())) or 1.0
    return np.concatenate([centres / spread, settings.turned * axes], axis=1)


def neighbours_of(
    view: int,
    views: ViewStack,
    near: float,
    far: float,
    settings: ChoiceSettings = SETTINGS,
    among: NDArray[np.bool_] | None = None,
) -> NDArray[np.int32]:
    """The views that a view is compared with, best first; empty where none overlaps.

    Args:
        near, far: depths between which the view's surfaces lie.
        among: [V] which views may be chosen; None for all.
    """
    width, height = views.sizes[view]
    u, v = np.meshgrid((np.arange(_GRID) + 0.5) * width / _GRID, (np.arange(_GRID) + 0.5) * height / _GRID)
    middle = 2.0 / (1.0 / near + 1.0 / far)  # the middle in inverse depth: planes are spaced so
    points = views.lifted(view, np.stack([u.ravel(), v.ravel()], 1), np.full(_GRID**2, middle))
    p = points @ views.projections.transpose(0, 2, 1) + views.offsets[:, None]
    z = p[..., 2]
    pixels = p[..., :2] / np.where(p[..., 2:] > 0, p[..., 2:], 1.0)
    inside = (z > 0) & (pixels >= 0).all(2) & (pixels < views.sizes[:, None]).all(2)
    seen = inside.mean(axis=1)
    ratio = np.median(z / middle, axis=1) * views.focals[view] / views.focals
    asked = (seen >= settings.overlap) & (1 / settings.closer < ratio) & (ratio < settings.closer)
    asked[view] = False
    if among is not None:
        asked &= among
    chosen = np.flatnonzero(asked)
    angle = _angles(points, inside[chosen], views.centres[view], views.centres[chosen])
    fits = (settings.smallest_angle <= angle) & (angle <= settings.largest_angle)
    score, directions = np.zeros(len(views)), np.zeros((len(views), 3))
    score[chosen] = seen[chosen] * np.exp(-(np.log(angle / settings.angle) ** 2)) * np.where(fits, 1.0, 1e-3)
    baselines = views.centres[chosen] - views.centres[view]
    directions[chosen] = baselines / np.maximum(np.linalg.norm(baselines, axis=1), 1e-12)[:, None]
    return _spread(score, directions, settings.neighbours)


def _angles(points: Floats, inside: NDArray[np.bool_], centre: Floats, others: Floats) -> Floats:
    """[V] degrees: the median of those between the rays from a camera at `centre` and from each of `others` [V, 3].

    Args:
        points: [K, 3] world; inside: [V, K] which of them each of the others sees, at least one.
    """
    own, rays = points - centre, points - others[:, None]
    cosine = (rays * own).sum(axis=2) / np.linalg.norm(rays, axis=2) / np.linalg.norm(own, axis=1)
    ordered, count = np.sort(np.where(inside, cosine, np.inf), axis=1), inside.sum(axis=1)
    each = np.arange(len(others))
    median = (ordered[each, (count - 1) // 2] + ordered[each, count // 2]) / 2
    return np.maximum(np.degrees(np.arccos(np.clip(median, -1, 1))), 1e-3)


def _spread(score: Floats, directions: Floats, count: int) -> NDArray[np.int32]:
    """The best, then others that are good and stand elsewhere: what one side cannot see, another may."""
    score = score.copy()
    chosen: list[int] = []
    while len(chosen) < count and score.max() > 0:
        best = int(score.argmax())
        chosen.append(best)
        score *= 1.0 - 0.5 * np.maximum(directions @ directions[best], 0.0)
        score[best] = 0.0
    return np.array(chosen, np.int32)
