"""What has changed, as it is said: one region after another, with intervals."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..evaluation.poses import Similarity
from ..measure.known import LengthScale
from ..measure.rows import NO_SCALE
from .evidence import Array

#: What may become of a region, and how it is said.
KINDS = {
    "moved": "stands elsewhere",
    "grew": "is wider",
    "shrank": "is narrower",
    "vanished": "is gone",
    "appeared": "is new",
    "repainted": "looks other, where it stood",
}
#: Of a normal distribution: 95 % lie within so many standard deviations.
WITHIN = 1.959964


@dataclass(frozen=True)
class Region:
    """A part of the surface that has changed.

    Attributes:
        kind: of `KINDS`.
        centre: [3] world of the first twin; pixel: size of a px-equivalent there, world units.
        area: px-equivalents squared (or another unit's, see `Changes.said`).
        value, deviation: by how much, px-equivalents: way, width, or height above what is behind; None if repainted.
        motion: [3] px-equivalents along the world's axes, zeros where nothing moved.
        direction: 'towards the cameras', 'away from the cameras', 'sideways' or ''.
        places: indices of the mesh's corners; after: whether of the second twin's mesh.
    """

    kind: str
    centre: Array
    pixel: float
    area: float
    value: float | None
    deviation: float | None
    motion: Array
    direction: str
    places: NDArray[np.int64] = field(repr=False)
    after: bool = False


@dataclass(frozen=True)
class Alignment:
    """How the second twin's world was brought into the first's.

    Attributes:
        similarity: from the second world into the first.
        how: 'same world' or 'matched photos'; matches: that agree on it.
        deviation: standard deviation that is left of it, px-equivalents, in the median of the surface.
        taken: largest common motion that the photos had taken out at the end, px-equivalents.
    """

    similarity: Similarity
    how: str
    matches: int
    deviation: float
    taken: float


@dataclass(frozen=True)
class Changes:
    """All that was found.

    Attributes:
        regions: the largest first; alignment: of the worlds.
        asked, held: places, and those that enough photos of both show.
        changed: share of the held surface in a region, by area.
        gain: of the light, median of the second's photos over the first's.
        mediums: of both twins, as text.
        size: [N] of each place's motion, px-equivalents; sure: [N] its standard deviation.
        scale: of the first world, where a length is known.
    """

    regions: tuple[Region, ...]
    alignment: Alignment
    asked: int
    held: NDArray[np.bool_] = field(repr=False)
    changed: float
    gain: float
    mediums: tuple[str, str]
    size: Array = field(repr=False)
    sure: Array = field(repr=False)
    scale: LengthScale | None = None

    @property
    def unit(self) -> str:
        """Of lengths, as they are said."""
        return NO_SCALE if self.scale is None else self.scale.known.unit

    def in_unit(self, pixel: Array) -> Array:
        """[N] how many units a px-equivalent is, where it is `pixel` [N] large in the first world."""
        return np.ones_like(pixel) if self.scale is None else pixel * self.scale.size

    def said(self, region: Region) -> Region:
        """A region with all its lengths in the unit that they are said in, and the scale's own deviation in theirs."""
        if self.scale is None:
            return region
        size = region.pixel * self.scale.size
        value, deviation = region.value, region.deviation
        if value is not None and deviation is not None:
            share = self.scale.deviation / self.scale.size
            # the variance of a product of independent factors
            deviation = size * float(np.sqrt(deviation**2 * (1 + share**2) + value**2 * share**2))
            value = size * value
        return replace(
            region, value=value, deviation=deviation, area=region.area * size**2, motion=region.motion * size
        )
