"""Loops of surfaces that are matched between views: a depth map smoothed, and how far away believed places are seen."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel

#: Places that are projected together, neighbours mostly: a view that sees none of them is done with at once.
_TOGETHER = 128


@kernel
def smooth_between_steps(begin, end, values, width, step, out):  # type: ignore[no-untyped-def]
    """Rows `begin` to `end` of a bilateral mean (Tomasi and Manduchi 1998): over what is near and nearly as large.

    How much others count falls with their difference as (1 - d^2 / 16)^8 does, a bell that ends, which is quick.

    Args:
        values: [H, W] float64, above 0; out: the same, output.
        width: standard deviation of the window, px; step: share of a value by which others may differ.
    """
    height, across = values.shape
    reach = int(2.0 * width + 0.5)
    total, weight = np.empty(across), np.empty(across)
    for y in range(begin, end):
        middle = values[y]
        total[:] = 0.0
        weight[:] = 0.0
        for j in range(max(0, y - reach), min(height, y + reach + 1)):
            for i in range(-reach, reach + 1):
                first, last = max(0, -i), across - max(0, i)
                if last <= first:
                    continue
                near = math.exp(-0.5 * ((j - y) * (j - y) + i * i) / (width * width))
                # (slices begin at 0, so that the loop over them runs in vector registers)
                here, there = middle[first:last], values[j, first + i : last + i]
                whole, share = total[first:last], weight[first:last]
                for x in range(last - first):
                    apart = (there[x] - here[x]) / (step * here[x])
                    bell = max(0.0, 1.0 - 0.0625 * apart * apart)
                    bell *= bell
                    bell *= bell
                    w = near * bell * bell
                    whole[x] += w * there[x]
                    share[x] += w
        for x in range(across):
            out[y, x] = total[x] / weight[x]


@kernel
def nearest_places(begin, end, positions, projections, offsets, sizes, nearest):  # type: ignore[no-untyped-def]
    """How far away the nearest place is that px of views `begin` to `end` see, or px beside them.

    Args:
        positions: [N, 3]; projections [V, 3, 3], offsets [V, 3], sizes [V, 2]: as in `ViewStack`.
        nearest: [V, H, W] float32 depths, infinite before; output.
    """
    across, along, deep = np.empty((3, _TOGETHER))
    inside = np.empty(nearest.shape[1:], np.float32)
    for view in range(begin, end):
        p, o = projections[view], offsets[view]
        width, height = sizes[view, 0], sizes[view, 1]
        inside[:, :] = np.inf
        for start in range(0, positions.shape[0], _TOGETHER):
            # (slices begin at 0, so that the loop over them runs in vector registers)
            points = positions[start : start + _TOGETHER]
            shown = 0
            for k in range(len(points)):
                x, y, z = points[k, 0], points[k, 1], points[k, 2]
                depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + o[2]
                u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + o[0]) / depth
                v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + o[1]) / depth
                there = (depth > 0.0) & (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
                across[k], along[k], deep[k] = u, v, depth if there else np.inf
                shown += there
            if shown == 0:
                continue
            for k in range(len(points)):
                if deep[k] < np.inf:
                    i, j = int(across[k]), int(along[k])
                    inside[j, i] = min(inside[j, i], np.float32(deep[k]))
        _spread(inside[:height, :width], nearest[view])


@inlined
def _spread(inside, nearest):  # type: ignore[no-untyped-def]
    """The least of each px [h, w] and of those around it, into [H, W]."""
    height, width = inside.shape
    for row in range(height):
        for column in range(width):
            least = np.float32(np.inf)
            for j in range(max(0, row - 1), min(height, row + 2)):
                for i in range(max(0, column - 1), min(width, column + 2)):
                    least = min(least, inside[j, i])
            nearest[row, column] = least
