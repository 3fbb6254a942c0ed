"""The loop of a place whose depth is matched: what another camera shows of a small plane at many depths."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel


@kernel
def plane_correlations(  # type: ignore[no-untyped-def]
    begin, end, depths, picture, turn, shift, x, y, nearer, values, faint, out
):
    """Correlation of a window with another camera's picture if its surface is a plane, at depths `begin` to `end`.

    Args:
        depths: [D] float64 of the plane in the middle of the window.
        picture: [H, W] float32 of the other camera.
        turn [3, 3], shift [3]: the other camera's (u z, v z, z) of a px = depth * turn @ (x, y, 1) + shift.
        x, y: [n] px of the window; nearer: [n] share of its depth that the plane is nearer there.
        values: [n] what the window shows, of mean 0 and length 1.
        faint: added to the length of what the picture shows.
        out: [D] float64, output; -1 where a px lies outside of the picture.
    """
    height, width = picture.shape
    count = len(values)
    seen = np.empty(count)
    for d in range(begin, end):
        out[d] = -1.0
        total, inside = 0.0, True
        for i in range(count):
            z = depths[d] / (1.0 - nearer[i])
            deep = z * (turn[2, 0] * x[i] + turn[2, 1] * y[i] + turn[2, 2]) + shift[2]
            if not deep > 0.0:
                inside = False
                break
            u = (z * (turn[0, 0] * x[i] + turn[0, 1] * y[i] + turn[0, 2]) + shift[0]) / deep
            v = (z * (turn[1, 0] * x[i] + turn[1, 1] * y[i] + turn[1, 2]) + shift[1]) / deep
            if not (0.0 <= u < width and 0.0 <= v < height):
                inside = False
                break
            u = min(max(u - 0.5, 0.0), width - 1.0)
            v = min(max(v - 0.5, 0.0), height - 1.0)
            column, row = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
            across, down = u - column, v - row
            right, below = min(column + 1, width - 1), min(row + 1, height - 1)
            above = (1.0 - across) * picture[row, column] + across * picture[row, right]
            under = (1.0 - across) * picture[below, column] + across * picture[below, right]
            seen[i] = (1.0 - down) * above + down * under
            total += seen[i]
        if not inside:
            continue
        mean = total / count
        squares, product = 0.0, 0.0
        for i in range(count):
            squares += (seen[i] - mean) ** 2
            product += (seen[i] - mean) * values[i]
        out[d] = product / (math.sqrt(squares) + faint)
