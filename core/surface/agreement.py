"""Depth maps checked by one another: a surface that only one view finds is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from .agreement_kernels import compare_with_maps
from .stack import Floats, ViewStack
from .sweep import DepthMap


@dataclass(frozen=True)
class AgreementSettings:
    """Of the check of depth maps between views."""

    same: float = number(
        0.01, "share of the depth", "within which two views see the same surface", FIRST_TRIED, LOOKED_AT
    )
    through: float = number(
        0.03, "share of the depth", "behind a point, from which on a view looks through it", FIRST_TRIED, LOOKED_AT
    )
    witnesses: int = number(
        2, "views", "that must see the same surface; one where few views are swept", FIRST_TRIED, LOOKED_AT
    )
    fewest: int = number(
        1, "views", "that are enough where no more look: at the edge of all photos", "see `SweepSettings.fewest`"
    )
    few: int = number(8, "views", "swept, below which one witness is enough", FIRST_TRIED, LOOKED_AT)
    conflicts: float = number(
        0.5, "share of the witnesses", "that may look through a point that is believed", FIRST_TRIED, LOOKED_AT
    )


SETTINGS = AgreementSettings()


@dataclass(frozen=True)
class Comparison:
    """Points against depth maps: [N] views that see the same surface, that see one behind, that look; depth ratio."""

    agree: NDArray[np.int32]
    conflict: NDArray[np.int32]
    asked: NDArray[np.int32]
    ratio: NDArray[np.float32]


def compared(
    positions: Floats,
    own: NDArray[np.int32],
    maps: Sequence[DepthMap],
    views: ViewStack,
    settings: AgreementSettings = SETTINGS,
) -> Comparison:
    """Compares points [N, 3] with all maps but each point's own ([N] indices into `maps`, or -1)."""
    agree, conflict, asked = np.zeros((3, len(positions)), np.int32)
    ratio = np.ones(len(positions), np.float32)
    if len(maps) and len(positions):
        depths, of = np.stack([m.depth for m in maps]), np.array([m.view for m in maps], np.int32)
        places = (views.projections, views.offsets, views.sizes)
        limits = (settings.same, settings.through)
        fixed = (np.ascontiguousarray(positions), own, depths, of, *places, *limits)
        compiled.run(compare_with_maps, len(positions), *fixed, agree, conflict, asked, ratio, grain=4096)
    return Comparison(agree, conflict, asked, ratio)


def agreed(
    maps: Sequence[DepthMap],
    views: ViewStack,
    settings: AgreementSettings = SETTINGS,
    among: Sequence[DepthMap] | None = None,
) -> list[DepthMap]:
    """The maps with only those px that enough others confirm, moved to the mean of what all of them see.

    Args:
        among: whole maps of the same views that are asked, where `maps` are parts of them.
    """
    lifted = [lifted_map(one, views) for one in maps]
    if not lifted:
        return []
    own = np.concatenate([np.full(len(p), i, np.int32) for i, p in enumerate(lifted)])
    found = compared(np.concatenate(lifted), own, maps if among is None else among, views, settings)
    needed = settings.witnesses if len(maps) >= settings.few else 1
    # At the edge of what is photographed fewer look than are needed elsewhere.
    needed_here = np.clip(found.asked, min(settings.fewest, needed), needed)
    believed = (found.agree >= needed_here) & (found.conflict <= settings.conflicts * found.agree)
    # Each further witness halves the doubt.
    factor = np.where(believed, 1.0 - 0.5**found.agree, 0.0)
    checked, at = [], 0
    for one, points in zip(maps, lifted, strict=True):
        part = slice(at, at + len(points))
        at += len(points)
        there = one.depth > 0
        depth, confidence = np.zeros_like(one.depth), np.zeros_like(one.confidence)
        depth[there] = one.depth[there] * found.ratio[part] * believed[part]
        confidence[there] = one.confidence[there] * factor[part]
        checked.append(DepthMap(one.view, depth, confidence))
    return checked


def lifted_map(one: DepthMap, views: ViewStack) -> Floats:
    """[K, 3] the points of a map, row by row."""
    rows, columns = np.nonzero(one.depth > 0)
    pixels = np.stack([columns, rows], axis=1) + 0.5
    return views.lifted(one.view, pixels, one.depth[rows, columns].astype(np.float64))
