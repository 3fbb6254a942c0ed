"""The visual hull (Laurentini 1994): where no photo shows that nothing is there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from .. import compiled
from ..numbers import BY_DEFINITION, number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from ..sfm.scatter import closest_point
from .hull_kernels import carve
from .stack import Floats, ViewStack

#: States of a cell: no statement, because too few photos look at it; seen to be empty; not seen to be.
UNSEEN, EMPTY, FILLED = 0, 1, 2


@dataclass(frozen=True)
class HullSettings:
    """Of the grid of cells."""

    cells: tuple[int, ...] = number(
        (24, 48, 96, 144),
        "count",
        "along the longest side, level by level; each looks only where the one before left some",
        FIRST_TRIED,
        LOOKED_AT,
    )
    votes: int = number(
        2,
        "photos",
        "that must see a cell empty: one may err where a thing looks like the background",
        FIRST_TRIED,
        LOOKED_AT,
    )
    vote_share: float = number(
        0.04, "share", "of the photos that look at a cell must see it empty, too", FIRST_TRIED, LOOKED_AT
    )
    looked_share: float = number(
        0.2, "share", "of all photos must look at a cell that counts as filled", FIRST_TRIED, LOOKED_AT
    )
    whole: float = number(0.87, "cell sizes", "from a cell's middle to its corner", BY_DEFINITION)
    half: float = number(0.5, "cell sizes", "from a cell's middle to its side: at the finest level", BY_DEFINITION)
    shown: float = number(
        0.02, "share", "of all px that must be empty before a hull is carved at all", FIRST_TRIED, LOOKED_AT
    )


SETTINGS = HullSettings()


@dataclass(frozen=True)
class Hull:
    """Cells and their states.

    Attributes:
        origin: [3] corner of the grid; size: of a cell; world units.
        states: [I, J, K] uint8, `UNSEEN`, `EMPTY` or `FILLED`.
        bounded: whether all that is filled lies inside the grid: an object that is seen from around.
    """

    origin: Floats
    size: float
    states: NDArray[np.uint8] = field(repr=False)
    bounded: bool

    def at(self, positions: Floats) -> NDArray[np.uint8]:
        """[N] states of the cells that hold the positions [N, 3]; outside of the grid nothing is stated."""
        cell = np.floor((positions - self.origin) / self.size).astype(np.int64)
        inside = ((cell >= 0) & (cell < self.states.shape)).all(axis=1)
        found = np.full(len(positions), UNSEEN, np.uint8)
        found[inside] = self.states[tuple(cell[inside].T)]
        return found

    def middles(self, which: NDArray[np.bool_]) -> Floats:
        """[K, 3] middles of cells."""
        return np.asarray(self.origin + (np.argwhere(which) + 0.5) * self.size)

    def surface(self) -> Floats:
        """[K, 3] middles of the filled cells that have an empty one beside them."""
        return self.middles((self.states == FILLED) & binary_dilation(self.states == EMPTY))

    def near_far(self, views: ViewStack, view: int) -> tuple[float, float] | None:
        """Depths between which a view sees what is filled; None if it sees nothing of it."""
        _, depth = views.depths(view, self.surface())
        return (float(depth.min()) - self.size, float(depth.max()) + self.size) if len(depth) else None


def carved_hull(views: ViewStack, settings: HullSettings = SETTINGS) -> Hull | None:
    """Carves away what the photos see to be empty; None where they say too little, or leave nothing."""
    if views.empty is None or views.empty.mean() < settings.shown:
        return None
    reach = _reach(views)
    middle = closest_point(views.centres, views.rotations[:, 2])
    half = float(np.linalg.norm(views.centres - middle, axis=1).max())
    outermost = low, high = middle - half, middle + half
    hull = None
    for level, cells in enumerate(settings.cells):
        finest = level == len(settings.cells) - 1
        size = float((high - low).max()) / cells
        shape = np.maximum(np.ceil((high - low) / size - 1e-6).astype(int), 1)
        states = np.full(shape, EMPTY, np.uint8)
        every = np.argwhere(np.ones(shape, bool)).astype(np.int32)
        before = np.full(len(every), FILLED) if hull is None else hull.at(low + (every + 0.5) * size)
        states.reshape(-1)[:] = np.where(before == EMPTY, EMPTY, UNSEEN)
        asked = every[before != EMPTY]
        slack = settings.half if finest else settings.whole
        states[tuple(asked.T)] = _states(views, reach, asked, low, size, slack, settings)
        filled = states == FILLED
        if not filled.any():
            return None
        sides = [np.flatnonzero(filled.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
        first, last = np.array([side[0] for side in sides]), np.array([side[-1] + 1 for side in sides])
        inside = (low + first * size > outermost[0] + 0.5 * size) & (low + last * size < outermost[1] - 0.5 * size)
        hull = Hull(low, size, states, bool(inside.all()))
        if not finest:
            low, high = low + (first - 1) * size, low + (last + 1) * size
    return hull


def _states(
    views: ViewStack,
    reach: NDArray[np.float32],
    cells: NDArray[np.int32],
    origin: Floats,
    size: float,
    slack: float,
    settings: HullSettings,
) -> NDArray[np.uint8]:
    seen, empty = np.zeros((2, len(cells)), np.int32)
    fixed = (views.projections, views.offsets, views.focals, views.sizes, reach)
    compiled.run(carve, len(cells), cells, origin, size, slack, *fixed, seen, empty, grain=4096)
    carved = empty >= np.maximum(settings.votes, settings.vote_share * seen)
    looked = seen >= max(settings.votes, settings.looked_share * len(views))
    return np.where(carved, EMPTY, np.where(looked, FILLED, UNSEEN)).astype(np.uint8)


def _reach(views: ViewStack) -> NDArray[np.float32]:
    """[V, H, W] px to the nearest px that is not empty."""
    assert views.empty is not None
    reach = np.zeros(views.empty.shape, np.float32)

    def one(view: int) -> None:
        empty = views.empty[view]  # type: ignore[index]
        if not empty.all():
            reach[view] = distance_transform_edt(empty)
        else:
            reach[view] = max(empty.shape)

    for view in range(len(views)):
        one(view)
    return reach
