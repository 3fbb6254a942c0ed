"""Points against the depth maps of many views: who sees the same surface there, and who sees through it."""

from __future__ import annotations

from ..compiled import kernel


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
    for n in range(begin, end):
        x, y, z = positions[n, 0], positions[n, 1], positions[n, 2]
        alike = seen = inside = 0
        total = 1.0
        for m in range(maps.shape[0]):
            if m == own[n]:
                continue
            p, o = projections[views[m]], offsets[views[m]]
            depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + o[2]
            if depth <= 0:
                continue
            across = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + o[0]) / depth - 0.5
            along = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + o[1]) / depth - 0.5
            if across < 0 or along < 0 or across >= sizes[views[m], 0] - 1 or along >= sizes[views[m], 1] - 1:
                continue
            i, j = int(across), int(along)
            inside += 1
            # The surface nearest to the point among the four px around it; behind it only where all of them are.
            nearest, least = 0.0, 1e30
            front, holes = 1e30, 0
            for b in range(j, j + 2):
                for a in range(i, i + 2):
                    found = maps[m, b, a]
                    if found <= 0:
                        holes += 1
                        continue
                    front = min(front, found)
                    if abs(found - depth) < least:
                        nearest, least = found, abs(found - depth)
            if holes == 4:
                continue
            if least < same * depth:
                alike += 1
                total += nearest / depth
            elif holes == 0 and front > (1.0 + through) * depth:
                seen += 1
        agree[n] = alike
        conflict[n] = seen
        asked[n] = inside
        ratio[n] = total / (alike + 1)
