"""Points against the depth maps of many views: who sees the same surface there, and who sees through it."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel

#: Points that are projected together, neighbours mostly: a map that none of them lies in is done with at once.
_TOGETHER = 128


@kernel
def compare_with_maps(  # type: ignore[no-untyped-def]
    begin, end, positions, own, maps, views, projections, offsets, sizes, same, through, agree, conflict, asked, ratio
):
    """For each point: how many maps hold a surface there, how many one behind it, and how far off it they are.

    Args:
        positions: [N, 3]; own: [N] int32, the map that the point is from, which is not asked; -1 for none.
        maps: [M, H, W] float32 depths, 0 where there is none; views: [M] int32, whose they are.
        projections [V, 3, 3], offsets [V, 3], sizes [V, 2]: as in `ViewStack`.
        same: share of the depth within which it is the same surface; through: share beyond which it is one behind.
        agree, conflict, asked: [N] int32 output; asked: maps whose frame holds the point.
        ratio: [N] float32 output, mean of the agreeing maps' depth over the point's; the point itself counts as 1.
    """
    across, along, deep = np.empty((3, _TOGETHER))
    alike, seen, inside = np.empty((3, _TOGETHER), np.int32)
    total = np.empty(_TOGETHER)
    for start in range(begin, end, _TOGETHER):
        count = min(_TOGETHER, end - start)
        # (slices begin at 0, so that the loop over them runs in vector registers)
        points, whose = positions[start : start + count], own[start : start + count]
        alike[:], seen[:], inside[:], total[:] = 0, 0, 0, 1.0
        for m in range(maps.shape[0]):
            p, o = projections[views[m]], offsets[views[m]]
            # (the last row and column have no px behind them to look at)
            right, bottom = sizes[views[m], 0] - 1.0, sizes[views[m], 1] - 1.0
            within = 0
            for k in range(count):
                x, y, z = points[k, 0], points[k, 1], points[k, 2]
                depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + o[2]
                i = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + o[0]) / depth - 0.5
                j = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + o[1]) / depth - 0.5
                shown = (depth > 0.0) & (i >= 0.0) & (j >= 0.0) & (i < right) & (j < bottom)
                across[k], along[k], deep[k] = i, j, depth if shown else 0.0
                within += shown
            if within == 0:
                continue
            for k in range(count):
                depth = deep[k]
                if depth == 0.0 or m == whose[k]:
                    continue
                i, j = int(across[k]), int(along[k])
                inside[k] += 1
                near = maps[m, j : j + 2, i : i + 2]
                # The surface nearest to the point among the four px around it; behind it only where all of them are.
                nearest, least = 0.0, 1e30
                front, holes = 1e30, 0
                for b in range(2):
                    for a in range(2):
                        found = float(near[b, a])
                        hole = found <= 0
                        holes += 1 if hole else 0
                        front = min(front, 1e30 if hole else found)
                        apart = 1e30 if hole else abs(found - depth)
                        nearest = found if apart < least else nearest
                        least = min(least, apart)
                if holes == 4:
                    continue
                if least < same * depth:
                    alike[k] += 1
                    total[k] += nearest / depth
                elif holes == 0 and front > (1.0 + through) * depth:
                    seen[k] += 1
        for k in range(count):
            n = start + k
            agree[n], conflict[n], asked[n] = alike[k], seen[k], inside[k]
            ratio[n] = total[k] / (alike[k] + 1)
