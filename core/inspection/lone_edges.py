"""Edges that have nothing near them: a piece nearly twice as large shows the same step.

A line that is hardly wider than the blur has two flanks, each of which a small piece describes by one step, up to a
fifth too narrow. A larger piece reaches across the line, and no step describes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..numbers import number
from .edges import Edges, find_edges, together
from .photo_set import PhotoSet

#: What these numbers were tried on.
TRIED = "one set behind Cycles' glass (the ball on its table)"


@dataclass(frozen=True)
class LoneEdgeSettings:
    """Numbers of edges that two sizes of pieces agree on."""

    finest: float = number(1.3, "px", "width that the smallest pieces are made for: smaller ones have one size")
    rung: float = number(1.3, "ratio", "of the widths that pieces are made for, one to the next")
    widths: int = number(9, "count", "that pieces are made for: up to 10 px")
    wider: int = number(2, "rungs", "by which the other piece is larger: 1.7 times")
    own: float = number(0.2, "log width", "by which an edge may differ from what its piece was made for")
    alike: float = number(0.1, "log width", "by which the two may differ", TRIED)
    near: float = number(1.5, "px", "from the one to the other")
    apart: int = number(4, "photos", "between those that are looked at first")
    enough: int = number(100, "edges", "after which no more photos are looked at: time only")


SETTINGS = LoneEdgeSettings()


def lone_edges(photos: PhotoSet) -> Edges:
    """Edges of `looked_at` that a piece made for their width and a larger one describe alike; as the larger one does.

    Photos are taken from all over the set, until there are enough.
    """
    count, found = len(photos.greys), list[Edges]()
    for index in sorted(range(count), key=lambda i: (i % SETTINGS.apart, i)):
        found.append(_of_photo(photos, index))
        if sum(len(edges) for edges in found) >= SETTINGS.enough:
            break
    return together(found)


def _of_photo(photos: PhotoSet, index: int) -> Edges:
    """Those of one photo."""
    made_for = SETTINGS.finest * SETTINGS.rung ** np.arange(SETTINGS.widths)
    grey, noise, clipped = photos.greys[index], photos.grey_noise[index], photos.clipped[index]
    rungs = [find_edges(grey, noise, float(width), clipped, index) for width in made_for]
    found = []
    for width, own, wider in zip(made_for, rungs, rungs[SETTINGS.wider :], strict=False):
        apart = np.abs(0.5 * np.log(np.maximum(own.variance, 1e-6) / width**2))
        found.append(_confirmed(own, apart < SETTINGS.own, wider))
    return together(found)


def _confirmed(own: Edges, fits: NDArray[np.bool_], wider: Edges) -> Edges:
    """Those of the wider pieces that stand where one of the others does that fits, and are as wide."""
    if not len(wider) or not fits.any():
        return wider.chosen(np.zeros(len(wider), bool))
    away, other = KDTree(np.stack([own.x[fits], own.y[fits]], axis=1)).query(np.stack([wider.x, wider.y], axis=1))
    ratio = np.maximum(wider.variance, 1e-6) / np.maximum(own.variance[fits][other], 1e-6)
    good = (away < SETTINGS.near) & (np.abs(0.5 * np.log(ratio)) < SETTINGS.alike)
    return wider.chosen(good)
