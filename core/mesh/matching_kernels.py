"""Loops of surfaces that are matched between views: a depth map smoothed, and how far away believed places are seen."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel


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
    for view in range(begin, end):
        p, o = projections[view], offsets[view]
        width, height = sizes[view, 0], sizes[view, 1]
        for n in range(positions.shape[0]):
            x, y, z = positions[n, 0], positions[n, 1], positions[n, 2]
            depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + o[2]
            if depth <= 0.0:
                continue
            u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + o[0]) / depth
            v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + o[1]) / depth
            if not (u >= 0.0 and v >= 0.0 and u < width and v < height):
                continue
            i, j = int(u), int(v)
            for row in range(max(0, j - 1), min(height, j + 2)):
                for column in range(max(0, i - 1), min(width, i + 2)):
                    nearest[view, row, column] = min(nearest[view, row, column], np.float32(depth))
