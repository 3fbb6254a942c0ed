"""Which tile sees which Gaussians, front to back: a stable counting sort, parallel and exact."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel
from .projection_kernels import R_FIRST, R_ROWS, kept_columns
from .splat_kernels import DEPTH, OPACITY, RED, X, Y

_BITS = 11
_BUCKETS = 1 << _BITS


@inlined
def comes_first(splats, left, right):  # type: ignore[no-untyped-def]
    """Order of two Gaussians at the same depth, by what they are rather than where they stand."""
    for column in (X, Y, OPACITY, RED, RED + 1, RED + 2):
        if splats[left, column] != splats[right, column]:
            return splats[left, column] < splats[right, column]
    return False


@kernel
def depth_order(splats, seen, order):  # type: ignore[no-untyped-def]
    """Indices of the seen Gaussians from near to far, into `order` [M] int32.

    Positive float32 sort like their bits: three radix passes of 11 bits. Ties are then ordered by
    content, so that the image does not depend on the order of the input.
    """
    count = seen.shape[0]
    keys = np.empty(count, np.uint32)
    other_keys = np.empty(count, np.uint32)
    other = np.empty(count, np.int32)
    for i in range(count):
        keys[i] = np.float32(splats[seen[i], DEPTH]).view(np.uint32)
        order[i] = seen[i]
    histogram = np.zeros((3, _BUCKETS + 1), np.int64)
    for i in range(count):
        for p in range(3):
            histogram[p, ((keys[i] >> np.uint32(_BITS * p)) & np.uint32(_BUCKETS - 1)) + 1] += 1
    for p in range(3):
        for b in range(_BUCKETS):
            histogram[p, b + 1] += histogram[p, b]
    for p in range(3):
        source_keys, source = (keys, order) if p != 1 else (other_keys, other)
        target_keys, target = (other_keys, other) if p != 1 else (keys, order)
        for i in range(count):
            b = (source_keys[i] >> np.uint32(_BITS * p)) & np.uint32(_BUCKETS - 1)
            to = histogram[p, b]
            histogram[p, b] += 1
            target_keys[to] = source_keys[i]
            target[to] = source[i]
    order[:] = other
    for i in range(1, count):
        j = i
        while j > 0 and other_keys[j - 1] == other_keys[i] and comes_first(splats, order[j], order[j - 1]):
            order[j], order[j - 1] = order[j - 1], order[j]
            j -= 1


@kernel
def count_pairs(begin, end, splats, records, order, chunk, tiles_x, width, counts):  # type: ignore[no-untyped-def]
    """How many Gaussians each chunk of the depth order puts into each tile: counts [chunks, tiles]."""
    for part in range(begin, end):
        counts[part, :] = 0
        for i in range(part * chunk, min((part + 1) * chunk, order.shape[0])):
            g = order[i]
            first = np.int64(records[g, R_FIRST])
            for row in range(first, first + np.int64(records[g, R_ROWS])):
                left, right = kept_columns(splats, records, g, row, width)
                for column in range(left, right):
                    counts[part, row * tiles_x + column] += 1


@kernel
def begin_pairs(counts, tile_starts):  # type: ignore[no-untyped-def]
    """Turns counts into the place where each chunk writes in each tile, and tiles' starts [tiles + 1]."""
    total = 0
    for tile in range(counts.shape[1]):
        tile_starts[tile] = total
        for part in range(counts.shape[0]):
            count = counts[part, tile]
            counts[part, tile] = total
            total += count
    tile_starts[counts.shape[1]] = total


@kernel
def place_pairs(begin, end, splats, records, order, chunk, tiles_x, width, slot_starts, places,
                pair_gaussians, pair_slots):  # type: ignore[no-untyped-def]  # fmt: skip
    """Writes the tiles' lists: Gaussian and gradient slot of every pair."""
    for part in range(begin, end):
        for i in range(part * chunk, min((part + 1) * chunk, order.shape[0])):
            g = order[i]
            slot = slot_starts[g]
            first = np.int64(records[g, R_FIRST])
            for row in range(first, first + np.int64(records[g, R_ROWS])):
                left, right = kept_columns(splats, records, g, row, width)
                for column in range(left, right):
                    to = places[part, row * tiles_x + column]
                    places[part, row * tiles_x + column] = to + 1
                    pair_gaussians[to] = g
                    pair_slots[to] = slot
                    slot += 1
