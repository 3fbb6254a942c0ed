"""One twin's surface before the photos of both."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..evaluation.poses import Similarity
from .evidence import Array, Evidence
from .motion import CommonMotion
from .regions import Tested
from .surface import Surface


@dataclass(frozen=True)
class Compared:
    """One surface before the photos of both twins.

    Attributes:
        surface, beside: that of one twin, and the other's.
        own, other: what both sets of photos say, rows paired, the common motion taken out of `other`.
        common: that motion; tested: what was found at each place; into: from the world of `beside` into this one.
        gap: [N] how much farther the other twin's surface lies than each place, px-equivalents; NaN where it has none.
    """

    surface: Surface
    beside: Surface
    own: Evidence
    other: Evidence
    common: CommonMotion
    tested: Tested
    gap: Array = field(repr=False)
    into: Similarity

    def depth_of(self, places: NDArray[np.int64]) -> Array:
        """[M] how far places lie inside a group [M], px-equivalents to the nearest held one outside; inf for none."""
        others = self.tested.held.copy()
        others[places] = False
        if not others.any():
            return np.full(len(places), np.inf)
        at = self.surface.places.at / np.median(self.surface.places.pixel)
        return np.asarray(cKDTree(at[others]).query(at[places])[0])
