"""Samples on the visual hull, for where nothing better was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from .agreement import compared
from .choice import chosen_references
from .hull import Hull
from .stack import Floats, ViewStack
from .sweep import DepthMap
from .union import Samples


@dataclass(frozen=True)
class HullSampleSettings:
    """Of samples on the hull."""

    views: int = number(24, "photos", "that colour the samples, evenly chosen", FIRST_TRIED, LOOKED_AT)
    hidden: float = number(
        2.5, "cells", "behind the hull's front, from which on a view does not see a sample", FIRST_TRIED, LOOKED_AT
    )
    front_side: int = number(
        2,
        "px",
        "side of the px of the hull's front: its cells must not leave holes between them",
        FIRST_TRIED,
        LOOKED_AT,
    )


SETTINGS = HullSampleSettings()


def hull_samples(
    hull: Hull, views: ViewStack, maps: Sequence[DepthMap], confidence: float, settings: HullSampleSettings = SETTINGS
) -> Samples:
    """The hull's surface where no map sees through it; the median colour of the views that it faces."""
    positions = hull.surface()
    free = compared(positions, np.full(len(positions), -1, np.int32), maps, views).conflict == 0
    seen: list[NDArray[np.float32]] = []
    spacing = np.full(len(positions), np.inf)
    for view in chosen_references(views, count=settings.views):
        colour, depth = _seen(view, views, positions, hull.size, settings)
        seen.append(colour)
        spacing = np.fmin(spacing, depth / views.focals[view])
    every = np.stack(seen)
    shown = np.isfinite(every[..., 0]).any(axis=0)
    kept = np.flatnonzero(free & shown)
    colours = np.nanmedian(every[:, kept], axis=0)
    sure = np.full(len(kept), confidence, np.float32)
    return Samples(positions[kept], colours.astype(np.uint8), sure, spacing[kept])


def _seen(
    view: int, views: ViewStack, positions: Floats, size: float, settings: HullSampleSettings
) -> tuple[NDArray[np.float32], Floats]:
    """[N, 3] colours and [N] depths in one view; NaN where it does not see the sample."""
    p = positions @ views.projections[view].T + views.offsets[view]
    depth = np.where(p[:, 2] > 0, p[:, 2], np.nan)
    with np.errstate(invalid="ignore"):
        pixels = p[:, :2] / depth[:, None]
        inside = np.flatnonzero((pixels >= 0).all(1) & (pixels < views.sizes[view]).all(1))
    x, y = pixels[inside].astype(int).T
    front = np.full(tuple(-(-n // settings.front_side) for n in views.grey.shape[1:]), np.inf)
    at = (y // settings.front_side, x // settings.front_side)
    np.minimum.at(front, at, depth[inside])
    ahead = depth[inside] < front[at] + settings.hidden * size
    ahead &= views.counts[view, y, x] if views.empty is None else views.counts[view, y, x] & ~views.empty[view, y, x]
    colours = np.full((len(positions), 3), np.nan, np.float32)
    colours[inside[ahead]] = views.colours[view, y[ahead], x[ahead]]
    depth[np.isnan(colours[:, 0])] = np.nan
    return colours, depth
