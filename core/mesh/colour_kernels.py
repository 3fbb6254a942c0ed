"""Colours of points on a surface from the views that see them."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel

f32 = np.float32


@kernel
def gather_colours(begin, end, points, depths, weights, images, starts, sizes, poses, lenses, near, colours, total):  # type: ignore[no-untyped-def]
    """Colours of points `begin` to `end`: the mean over the views that see them, by their weights.

    Args:
        points: [N, 3] float64; near: [N] how far from a view's surface a point is still on it, world units.
        depths, weights: [P] float32 px of all views behind each other; images: [P, 3] float32.
        starts, sizes, poses, lenses: as of `fuse`.
        colours: [N, 3] float32 output; total: [N] float32 output, sum of weights: 0 where no view sees the point.
    """
    for n in range(begin, end):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        red, green, blue, whole = f32(0.0), f32(0.0), f32(0.0), f32(0.0)
        for view in range(len(starts)):
            r, lens = poses[view], lenses[view]
            depth = r[6] * x + r[7] * y + r[8] * z + r[11]
            if depth <= 0.0:
                continue
            u = lens[0] * (r[0] * x + r[1] * y + r[2] * z + r[9]) / depth + lens[2]
            v = lens[1] * (r[3] * x + r[4] * y + r[5] * z + r[10]) / depth + lens[3]
            if not (u >= 0.0 and v >= 0.0 and u < sizes[view, 1] and v < sizes[view, 0]):
                continue
            pixel = starts[view] + np.int64(v) * sizes[view, 1] + np.int64(u)
            weight = weights[pixel]
            if weight > f32(0.0) and abs(np.float64(depths[pixel]) - depth) <= near[n]:
                red += weight * images[pixel, 0]
                green += weight * images[pixel, 1]
                blue += weight * images[pixel, 2]
                whole += weight
        total[n] = whole
        if whole > f32(0.0):
            colours[n, 0], colours[n, 1], colours[n, 2] = red / whole, green / whole, blue / whole
        else:
            colours[n, :] = f32(0.5)
