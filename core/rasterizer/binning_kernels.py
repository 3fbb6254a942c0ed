"""Which tile sees which Gaussians, front to back: a stable counting sort, parallel and exact."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel
from .projection_kernels import R_FIRST, R_ROWS, RECORD_WIDTH, kept_columns
from .splat_kernels import DEPTH, GAUSSIAN, OPACITY, RED, SLOT, X, Y, prefetch

_BITS = 11
_BUCKETS = 1 << _BITS
#: For how many Gaussians ahead memory is asked for: every branch here waits for it.
_AHEAD = 16


@inlined
def comes_first(splats, left, right):  # type: ignore[no-untyped-def]
    """Order of two Gaussians at the same depth, by what they are rather than where they stand."""
    for column in (X, Y, OPACITY, RED, RED + 1, RED + 2):
        if splats[left, column] != splats[right, column]:
            return splats[left, column] < splats[right, column]
    return False


@inlined
def sort_alike(splats, order, scratch, begin, end):  # type: ignore[no-untyped-def]
    """Sorts `order[begin:end]`, Gaussians at the same depth, by content: a stable merge sort from the bottom up.

    A few are the rule. Of a flat wall that faces the camera it may be all.
    """
    width = 1
    while width < end - begin:
        for start in range(begin, end, 2 * width):
            middle, stop = min(start + width, end), min(start + 2 * width, end)
            left, right = start, middle
            for to in range(start, stop):
                take_right = right < stop and (left >= middle or comes_first(splats, order[right], order[left]))
                if take_right:
                    scratch[to] = order[right]
                    right += 1
                else:
                    scratch[to] = order[left]
                    left += 1
        for i in range(begin, end):
            order[i] = scratch[i]
        width *= 2


@kernel
def list_seen(status, tile_counts, seen, slot_starts, reasons):  # type: ignore[no-untyped-def]
    """Which Gaussians are seen, where the gradient slots of each one begin, and how many have which status.

    Args:
        status: [N] why each is culled, or that it is not; tile_counts: [N] tiles that each one meets.
        seen: [N] int32 output, the indices of those that meet a tile; returns how many they are.
        slot_starts: [N + 1] int64 output.
        reasons: [statuses] int64 output, how many Gaussians have each status.
    """
    count = total = 0
    reasons[:] = 0
    for g in range(status.shape[0]):
        slot_starts[g] = total
        total += tile_counts[g]
        seen[count] = g
        count += tile_counts[g] > 0
        reasons[status[g]] += 1
    slot_starts[status.shape[0]] = total
    return count


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
    begin = 0
    for i in range(1, count + 1):
        if i == count or other_keys[i] != other_keys[begin]:
            if i - begin > 1:
                sort_alike(splats, order, other, begin, i)
            begin = i


@kernel
def count_pairs(begin, end, splats, records, order, chunk, tiles_x, width, steps):  # type: ignore[no-untyped-def]
    """How many Gaussians each chunk of the depth order puts into each tile.

    Args:
        steps: [chunks, tiles_y, tiles_x + 1] int32 output, by how much a tile has more than its left neighbour.
    """
    for part in range(begin, end):
        steps[part, :, :] = 0
        stop = min((part + 1) * chunk, order.shape[0])
        for i in range(part * chunk, stop):
            prefetch(records, np.int64(order[min(i + _AHEAD, stop - 1)]) * RECORD_WIDTH)
            g = order[i]
            first = np.int64(records[g, R_FIRST])
            for row in range(first, first + np.int64(records[g, R_ROWS])):
                left, right = kept_columns(splats, records, g, row, width)
                steps[part, row, left] += 1
                steps[part, row, right] -= 1


@kernel
def begin_pairs(places, tile_starts):  # type: ignore[no-untyped-def]
    """Turns steps into the place where each chunk writes in each tile, and tiles' starts [tiles + 1]."""
    parts, tiles_y, tiles_x = places.shape[0], places.shape[1], places.shape[2] - 1
    total = 0
    for row in range(tiles_y):
        for column in range(tiles_x):
            tile_starts[row * tiles_x + column] = total
            for part in range(parts):
                count = places[part, row, column]
                places[part, row, column + 1] += count
                places[part, row, column] = total
                total += count
    tile_starts[tiles_y * tiles_x] = total


@kernel
def place_pairs(begin, end, splats, records, order, chunk, tiles_x, width, slot_starts, places, pairs):  # type: ignore[no-untyped-def]
    """Writes the tiles' lists: Gaussian and gradient slot of every pair."""
    for part in range(begin, end):
        stop = min((part + 1) * chunk, order.shape[0])
        for i in range(part * chunk, stop):
            ahead = np.int64(order[min(i + _AHEAD, stop - 1)])
            prefetch(records, ahead * RECORD_WIDTH)
            prefetch(slot_starts, ahead)
            g = order[i]
            slot = slot_starts[g]
            first = np.int64(records[g, R_FIRST])
            for row in range(first, first + np.int64(records[g, R_ROWS])):
                left, right = kept_columns(splats, records, g, row, width)
                for column in range(left, right):
                    to = places[part, row, column]
                    places[part, row, column] = to + 1
                    pairs[to, GAUSSIAN] = g
                    pairs[to, SLOT] = slot
                    slot += 1
