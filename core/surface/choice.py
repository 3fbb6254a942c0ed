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
    score = np.zeros(len(views))
    directions = np.zeros((len(views), 3))
    own = points - views.centres[view]
    for other in range(len(views)):
        if other == view or not (among is None or among[other]):
            continue
        p = points @ views.projections[other].T + views.offsets[other]
        pixels = p[:, :2] / np.where(p[:, 2:] > 0, p[:, 2:], 1.0)
        inside = (p[:, 2] > 0) & (pixels >= 0).all(1) & (pixels < views.sizes[other]).all(1)
        ratio = float(np.median(p[:, 2] / middle)) * views.focals[view] / views.focals[other]
        if inside.mean() < settings.overlap or not 1 / settings.closer < ratio < settings.closer:
            continue
        rays = points[inside] - views.centres[other]
        cosine = (rays * own[inside]).sum(1) / np.linalg.norm(rays, axis=1) / np.linalg.norm(own[inside], axis=1)
        angle = max(float(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1)))), 1e-3)
        fits = settings.smallest_angle <= angle <= settings.largest_angle
        score[other] = inside.mean() * np.exp(-(np.log(angle / settings.angle) ** 2)) * (1.0 if fits else 1e-3)
        baseline = views.centres[other] - views.centres[view]
        directions[other] = baseline / max(float(np.linalg.norm(baseline)), 1e-12)
    return _spread(score, directions, settings.neighbours)


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
