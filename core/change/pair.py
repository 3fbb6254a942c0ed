"""One twin's surface before the photos of both."""

from __future__ import annotations

from dataclasses import dataclass, field

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
