"""Depth of a view's px by plane sweep (Collins 1996) over its neighbours, with how sure it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from .hull import EMPTY, Hull
from .hull_kernels import bar_planes
from .stack import Floats, ViewStack
from .sweep_kernels import BARRED, best_planes, plane_costs, window_statistics


@dataclass(frozen=True)
class SweepSettings:
    """Of the planes, the windows, and of what is believed."""

    planes: int = number(
        80, "count", "inverse depths, evenly spaced between the nearest and the farthest", FIRST_TRIED, LOOKED_AT
    )
    radius: int = number(
        2,
        "px",
        "windows of (2 radius + 1)^2 px are compared; larger: steadier, and blunter at edges",
        FIRST_TRIED,
        LOOKED_AT,
    )
    texture: float = number(
        0.012,
        "share of white",
        "standard deviation of a window below which it shows noise rather than texture",
        FIRST_TRIED,
        LOOKED_AT,
    )
    fewest: int = number(
        1,
        "views",
        "besides its own that must see a window, 1 or 2: at the edge of what is photographed there is one",
        "a village from above, 30 sharp photos: drafts of 25.14 -> 25.83 dB, with `AgreementSettings.fewest`",
        "another village 30.05 -> 30.35, ball 27.72 -> 27.90, room 26.80 -> 26.74, shelf 32.60 -> 32.58",
    )
    apart: int = number(3, "planes", "between two minima that count as two", FIRST_TRIED, LOOKED_AT)
    largest_cost: float = number(
        0.4, "1 - correlation", "of the best plane, above which no view agrees", FIRST_TRIED, LOOKED_AT
    )
    sure_cost: float = number(
        0.1, "1 - correlation", "below which the agreement could not be better", FIRST_TRIED, LOOKED_AT
    )
    least_margin: float = number(
        0.04,
        "correlation",
        "by which the best plane must beat every other minimum: repetitive texture has many",
        FIRST_TRIED,
        LOOKED_AT,
    )
    sure_margin: float = number(0.3, "correlation", "of a minimum that nothing comes near", FIRST_TRIED, LOOKED_AT)


SETTINGS = SweepSettings()


@dataclass(frozen=True)
class DepthMap:
    """What a sweep found of one view.

    Attributes:
        view: its index.
        depth: [H, W] float32 along the axis, world units; 0 where nothing is believed.
        confidence: [H, W] float32 in [0, 1].
    """

    view: int
    depth: NDArray[np.float32] = field(repr=False)
    confidence: NDArray[np.float32] = field(repr=False)


@dataclass(frozen=True)
class Around:
    """Depths that are nearly known: surfaces are sought in a band around them.

    Attributes:
        depth: [H, W] float64 world units, above 0.
        band: share of the depth by which a surface may lie nearer or farther.
    """

    depth: Floats = field(repr=False)
    band: float


def swept(
    view: int,
    views: ViewStack,
    others: NDArray[np.int32],
    bounds: tuple[float, float] | Around,
    wanted: NDArray[np.bool_],
    hull: Hull | None = None,
    settings: SweepSettings = SETTINGS,
) -> DepthMap:
    """The depth of a view's px.

    Args:
        others: [N] indices of its neighbours.
        bounds: depths between which surfaces are sought, world units, on planes that face the view; or the depths
            around which each px is asked.
        wanted: [H, W] px that are asked.
        hull: whose empty cells hold no surface.
    """
    shape = wanted.shape
    nothing = DepthMap(view, np.zeros(shape, np.float32), np.zeros(shape, np.float32))
    rows, columns = np.flatnonzero(wanted.any(1)), np.flatnonzero(wanted.any(0))
    if len(others) == 0 or len(rows) == 0:
        return nothing
    grey = views.grey[view]
    mean, scale = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    least = np.float32(settings.texture)
    compiled.run(window_statistics, shape[0], grey, wanted, settings.radius, least, mean, scale, grain=8)
    turns = np.einsum("nij,jk->nik", views.projections[others], views.inverse[view])
    shifts = np.einsum("nij,j->ni", views.projections[others], views.centres[view]) + views.offsets[others]
    around = 1.0 / bounds.depth if isinstance(bounds, Around) else np.ones(shape)
    nearest, farthest = (1 / (1 + bounds.band), 1 + bounds.band) if isinstance(bounds, Around) else bounds
    planes = np.linspace(1.0 / farthest, 1.0 / nearest, settings.planes)
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.int64)
    costs = np.full((settings.planes, *shape), 2.0, np.float32)
    fixed = (grey, mean, scale, box, views.grey, views.counts, views.sizes, others, turns, shifts, planes, around)
    compiled.run(plane_costs, settings.planes, *fixed, settings.radius, settings.fewest, costs)
    if hull is not None:
        grid = (hull.states, hull.origin, hull.size, EMPTY, np.float32(BARRED))
        rays = (box, views.inverse[view], views.centres[view], planes, around)
        compiled.run(bar_planes, settings.planes, *rays, *grid, costs)
    index, cost, margin = (np.zeros(shape, np.float32) for _ in range(3))
    compiled.run(best_planes, shape[0], costs, scale, settings.apart, index, cost, margin, grain=8)
    confidence = np.clip((settings.largest_cost - cost) / (settings.largest_cost - settings.sure_cost), 0, 1)
    distinct = (margin - settings.least_margin) / (settings.sure_margin - settings.least_margin)
    confidence *= np.clip(distinct, 0, 1) * (index >= 0)
    inverse = planes[0] + index * (planes[1] - planes[0])
    depth = np.where(confidence > 0, 1.0 / np.maximum(inverse, planes[0]), 0.0)
    if isinstance(bounds, Around):
        depth = depth * bounds.depth
    return DepthMap(view, depth.astype(np.float32), confidence.astype(np.float32))
