"""What marching cubes is given of a field of distances, and which of its corners are one and the same."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
from .fusion_kernels import SIDE

#: Corners in whole numbers of voxels are rounded by less than this (64 in float32 has steps of 8e-6).
_WHOLE = 1e-5


#: Where a voxel lies: bits, so that those of a cell's corners can be read from one number.
_BEHIND, _FRONT, _UNSEEN = np.uint8(1), np.uint8(2), np.uint8(4)


@kernel
def fill_part(begin, end, ids, values, weights, least, out, sides):  # type: ignore[no-untyped-def]
    """Layers `begin` to `end` of blocks side by side in one array.

    Args:
        ids: [X, Y, Z] index of the block at each place, -1 where there is none.
        values, weights: [B, 8, 8, 8] float32, see `Volume`.
        least: distance to zero that values are moved to from nearer it.
        out: [A, B, C] float32 output, 1 where nothing is.
        sides: [A, B, C] uint8 output: `_BEHIND` the surface, in `_FRONT` of it, or `_UNSEEN`.
    """
    across, deep = out.shape[1], out.shape[2]
    for x in range(begin, end):
        for y in range(across):
            for block in range((deep + SIDE - 1) // SIDE):
                z0, index = block * SIDE, ids[x // SIDE, y // SIDE, block]
                for k in range(min(SIDE, deep - z0)):
                    value, known = np.float32(1.0), False
                    if index >= 0:
                        value = values[index, x % SIDE, y % SIDE, k]
                        known = weights[index, x % SIDE, y % SIDE, k] > 0
                        if abs(value) < least:
                            value = -least if value < 0 else least
                    out[x, y, z0 + k] = value
                    sides[x, y, z0 + k] = (_BEHIND if value < 0 else _FRONT) if known else _UNSEEN


@kernel
def find_cells(begin, end, sides, cells):  # type: ignore[no-untyped-def]
    """Marks the cells that a surface passes through: all corners were seen, and they lie on both sides of it.

    Args:
        begin, end: layers; sides: [A, B, C] of `fill_part`.
        cells: [A, B, C] bool output; a cell is named by its last corner.

    Returns:
        how many there are.
    """
    count = 0
    for x in range(begin, end):
        for y in range(sides.shape[1]):
            cells[x, y, :] = False
            if x == 0 or y == 0:
                continue
            one, two, three, four = sides[x, y], sides[x - 1, y], sides[x, y - 1], sides[x - 1, y - 1]
            last = cells[x, y, 1:]
            for z in range(len(last)):
                corners = one[z] | two[z] | three[z] | four[z] | one[z + 1] | two[z + 1] | three[z + 1] | four[z + 1]
                last[z] = corners == (_BEHIND | _FRONT)
                count += last[z]
    return count


@kernel
def corner_keys(begin, end, corners, shape, keys):  # type: ignore[no-untyped-def]
    """A number for the edge of the grid that each corner lies on; below 0 for one that lies within a cell.

    Args:
        corners: [N, 3] float64, in voxels; shape: [3] voxels of the grid.
        keys: [N] int64 output.
    """
    for n in range(begin, end):
        place, axis, many = np.int64(0), 3, 0
        for k in range(3):
            nearest = np.rint(corners[n, k])
            off = abs(corners[n, k] - nearest) > _WHOLE
            if off:
                axis = k
                many += 1
            place = place * shape[k] + np.int64(math.floor(corners[n, k] + _WHOLE) if off else nearest)
        keys[n] = place * 4 + axis if many == 1 else -1 - n
