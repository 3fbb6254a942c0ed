"""Many overlapping samples of surfaces, made one set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from ..views import SparsePoints
from .stack import Floats

#: Cells along each axis at most: as many that a few million samples and their ranks fit into a key of 63 bits.
_ROOM = 1 << 40


@dataclass(frozen=True)
class UnionSettings:
    """Of the set of points."""

    near: float = number(
        2.0, "cells", "within which a better sample leaves no need for a worse one", FIRST_TRIED, LOOKED_AT
    )


SETTINGS = UnionSettings()


@dataclass(frozen=True)
class Samples:
    """Samples of surfaces.

    Attributes:
        positions: [N, 3] float64; colours: [N, 3] uint8; confidence: [N] float32 in (0, 1].
        spacing: [N] float64, world units that a px of the view covers there.
    """

    positions: Floats
    colours: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    spacing: Floats

    def __len__(self) -> int:
        return len(self.positions)

    def chosen(self, which: NDArray[np.bool_]) -> Samples:
        """Some of them."""
        return Samples(self.positions[which], self.colours[which], self.confidence[which], self.spacing[which])


def joined(parts: Sequence[Samples]) -> Samples:
    """All of them, in this order."""
    fields = ("positions", "colours", "confidence", "spacing")
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))


def merged_in(
    parts: Sequence[Samples], side: float, most: int | None = None, settings: UnionSettings = SETTINGS
) -> SparsePoints:
    """One point for each cell that holds samples: their mean place, median colour and best confidence.

    Args:
        parts: the most trustworthy first; samples of later ones count only where none of earlier ones are near.
        side: of the cells, px of a small view; they grow with the distance from which the samples were seen (by powers
            of two), as a px does.
        most: points at most, by chance; None for all.

    Returns:
        Points in an order of no meaning: denser where more views look, who say more of it.
    """
    samples, rank = _ranked(parts)
    if len(samples) == 0:
        return _nothing()
    kept = _kept(samples, rank, side, settings)
    points = _merged(kept, _keys(kept, side))
    return points if most is None or len(points.positions) <= most else points.chosen(np.arange(most))


def _ranked(parts: Sequence[Samples]) -> tuple[Samples, NDArray[np.int64]]:
    """All samples, and the part that each is of."""
    return joined(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])


def _nothing() -> SparsePoints:
    return SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))


def _kept(samples: Samples, rank: NDArray[np.int64], side: float, settings: UnionSettings) -> Samples:
    """Without those that have a more trustworthy one in their (wider) cell."""
    _, index = np.unique(_keys(samples, settings.near * side), return_inverse=True)
    best = np.full(index.max() + 1, rank.max())
    np.minimum.at(best, index, rank)
    return samples.chosen(rank == best[index])


def _keys(samples: Samples, side: float) -> NDArray[np.int64]:
    """[N] a number for the cell of each sample, in the order of levels, x, y, z.

    Things at hand before a far horizon need more cells along an axis than a key has room for: then what is in the key
    so far is replaced by its rank.
    """
    level = np.floor(np.log2(np.maximum(samples.spacing, 1e-300)))
    cell = np.floor((samples.positions - samples.positions.min(0)) / (side * 2.0**level)[:, None])
    cell = np.minimum(cell, _ROOM - 1).astype(np.int64)
    key = (level - level.min()).astype(np.int64)
    count = int(key.max()) + 1
    for column in cell.T:
        along = int(column.max()) + 1
        if count * along >= 1 << 63:
            key = np.unique(key, return_inverse=True)[1]
            count = int(key.max()) + 1
        key, count = key * along + column, count * along
    return np.asarray(key)


def _merged(samples: Samples, keys: NDArray[np.int64]) -> SparsePoints:
    _, index, counts = np.unique(keys, return_inverse=True, return_counts=True)
    total = len(counts)
    weight = samples.confidence.astype(np.float64)
    whole = np.bincount(index, weight, total)
    places = [np.bincount(index, weight * samples.positions[:, k], total) / whole for k in range(3)]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    colours = np.empty((total, 3), np.uint8)
    for k in range(3):  # (cell and colour in one number: to sort these is three times quicker than to order by both)
        ordered = np.sort(index.astype(np.int64) * 256 + samples.colours[:, k])
        colours[:, k] = ordered[starts + counts // 2] % 256
    best = np.zeros(total, np.float32)
    np.maximum.at(best, index, samples.confidence)
    # In an order of no meaning: whoever takes the first thousand takes them from everywhere.
    shuffled = np.random.default_rng(0).permutation(total)
    return SparsePoints(np.stack(places, axis=1)[shuffled], colours[shuffled], best[shuffled])
