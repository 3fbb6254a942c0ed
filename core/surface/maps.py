"""Depth maps as samples of surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .agreement import lifted_map
from .stack import ViewStack
from .sweep import DepthMap
from .union import Samples, joined


def wanted_pixels(views: ViewStack, view: int) -> NDArray[np.bool_]:
    """[H, W] px of a view that count and are not known to be empty: those that a surface is wanted for."""
    return views.counts[view] if views.empty is None else views.counts[view] & ~views.empty[view]


def share_confirmed(checked: Sequence[DepthMap], views: ViewStack) -> float:
    """Share of the px that a surface is wanted for that have a depth."""
    wanted = sum(int(wanted_pixels(views, one.view).sum()) for one in checked)
    return sum(int((one.depth > 0).sum()) for one in checked) / max(1, wanted)


def samples_of(maps: Sequence[DepthMap], views: ViewStack, least: float, even: bool = False) -> Samples:
    """The px of maps as samples; their confidence from `least` to 1, or `least` for all."""
    parts = []
    for one in maps:
        there = one.depth > 0
        own = one.confidence[there]
        sure = np.full_like(own, least) if even else least + (1 - least) * own
        colours = views.colours[one.view][: there.shape[0], : there.shape[1]][there]
        spacing = one.depth[there].astype(np.float64) / views.focals[one.view]
        parts.append(Samples(lifted_map(one, views), colours, sure.astype(np.float32), spacing))
    return joined(parts)
