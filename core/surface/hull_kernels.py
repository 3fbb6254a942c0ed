"""Visual hull: which cells of a grid some photos see to be empty."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel


@kernel
def carve(begin, end, cells, origin, size, slack, projections, offsets, focals, sizes, reach, seen, empty):  # type: ignore[no-untyped-def]
    """For each cell: how many views look at it, and how many of these see nothing there.

    Args:
        cells: [N, 3] int32; a cell's middle is origin + (cell + 0.5) size.
        slack: cell sizes around the middle that must be empty, too.
        projections [V, 3, 3], offsets [V, 3], focals [V], sizes [V, 2]: as in `ViewStack`.
        reach: [V, H, W] float32, px from every px to the nearest that is not empty.
        seen, empty: [N] int32 output.
    """
    for n in range(begin, end):
        x = origin[0] + (cells[n, 0] + 0.5) * size
        y = origin[1] + (cells[n, 1] + 0.5) * size
        z = origin[2] + (cells[n, 2] + 0.5) * size
        looked = nothing = 0
        for v in range(projections.shape[0]):
            p = projections[v]
            depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + offsets[v, 2]
            if depth <= size:
                continue
            across = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + offsets[v, 0]) / depth
            along = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + offsets[v, 1]) / depth
            if across < 0 or along < 0 or across >= sizes[v, 0] or along >= sizes[v, 1]:
                continue
            looked += 1
            # (half a px: from a px' middle to its edge)
            nothing += reach[v, int(along), int(across)] > slack * size * focals[v] / depth + 0.5
        seen[n] = looked
        empty[n] = nothing


@kernel
def bar_planes(  # type: ignore[no-untyped-def]
    begin, end, box, inverse, centre, planes, around, grid, origin, size, empty, barred, costs
):
    """Bars the planes at which a px' ray runs through empty cells, for a range of planes.

    Args:
        box: [4] x0, y0, x1, y1 of the px that are wanted.
        inverse [3, 3], centre [3]: of the view, as in `ViewStack`; planes: [D] inverse depths, as multiples of
            around: [H, W].
        grid: [I, J, K] uint8 states of cells of `size` from `origin`; empty: the state that bars.
        barred: the cost that is written into costs [D, H, W] float32.
    """
    for d in range(begin, end):
        for y in range(box[1], box[3]):
            for x in range(box[0], box[2]):
                z = 1.0 / (planes[d] * around[y, x])
                u, v = x + 0.5, y + 0.5
                a = centre[0] + z * (inverse[0, 0] * u + inverse[0, 1] * v + inverse[0, 2])
                b = centre[1] + z * (inverse[1, 0] * u + inverse[1, 1] * v + inverse[1, 2])
                c = centre[2] + z * (inverse[2, 0] * u + inverse[2, 1] * v + inverse[2, 2])
                i = int(np.floor((a - origin[0]) / size))
                j = int(np.floor((b - origin[1]) / size))
                k = int(np.floor((c - origin[2]) / size))
                inside = i >= 0 and j >= 0 and k >= 0 and i < grid.shape[0] and j < grid.shape[1] and k < grid.shape[2]
                if inside and grid[i, j, k] == empty:
                    costs[d, y, x] = barred
