"""Small islands in a depth map are taken away: a match that is mistaken stands alone (the speckle filter of stereo).

Views that agree by chance do so in a few px; a surface goes on beside them. For sweeps over all depths: in a narrow
band around known points less is chance, and thin things are islands, too; so it is within the hull of an object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..numbers import number
from .sweep import DepthMap


@dataclass(frozen=True)
class SpeckleSettings:
    """Of what is an island."""

    step: float = number(
        0.05, "share of the depth", "between neighbours of one surface", "thought of; no other value was tried"
    )
    least: int = number(
        10,
        "px",
        "of an island that is kept",
        "27 photos behind rendered frosted glass, against true depths: 10, 30 and 100 take nearly the same away",
    )


SETTINGS = SpeckleSettings()


def without_speckles(maps: Sequence[DepthMap], settings: SpeckleSettings = SETTINGS) -> list[DepthMap]:
    """The maps without islands of fewer px than count as a surface."""
    return [_cleared(one, settings) for one in maps]


def _cleared(one: DepthMap, settings: SpeckleSettings) -> DepthMap:
    kept = (one.depth > 0) & (_sizes(one.depth, settings.step) >= settings.least)
    depth, confidence = (np.where(kept, values, 0).astype(np.float32) for values in (one.depth, one.confidence))
    return DepthMap(one.view, depth, confidence)


def _sizes(depth: NDArray[np.float32], step: float) -> NDArray[np.int64]:
    """[H, W] px of the island that each px belongs to: neighbours along rows and columns whose depths are alike."""
    index = np.arange(depth.size).reshape(depth.shape)
    logs = np.where(depth > 0, np.log(np.maximum(depth, np.finfo(np.float32).tiny)), np.nan)
    beside = np.abs(np.diff(logs, axis=1)) < step
    below = np.abs(np.diff(logs, axis=0)) < step
    one = np.concatenate([index[:, :-1][beside], index[:-1][below]])
    other = np.concatenate([index[:, 1:][beside], index[1:][below]])
    joined = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(depth.size, depth.size))
    _, label = connected_components(joined, directed=False)
    return np.asarray(np.bincount(label)[label].reshape(depth.shape))
