"""Compiled: what a blur leaves of the power of bands, and what photos of a point then still differ by.

A glass is searched for by trying thousands of them on a few thousand observations.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel


@kernel
def interpolate(x, at, knots, fine, coarse, values, out):  # type: ignore[no-untyped-def]
    """Linear between `values` [T] at places `at` [T], rising, even in two parts; constant beyond, as numpy's `interp`.

    Args:
        x: [N] float64.
        knots: places in the first part; fine, coarse: 1 / their distance in the first part, and in the second.
        out: [N] float64, written.
    """
    last = len(at) - 1
    for n in range(len(x)):
        where = x[n]
        if math.isnan(where) or where <= at[0]:
            out[n] = where if math.isnan(where) else values[0]
            continue
        if where >= at[last]:
            out[n] = values[last]
            continue
        if where < at[knots - 1]:
            k = min(int((where - at[0]) * fine), knots - 2)
        else:
            k = min(knots - 1 + int((where - at[knots - 1]) * coarse), last - 1)
        while at[k] > where:
            k -= 1
        while at[k + 1] <= where:
            k += 1
        out[n] = (values[k + 1] - values[k]) / (at[k + 1] - at[k]) * (where - at[k]) + values[k]


@kernel
def take_off_common(values, point, photo, seen, held, rounds):  # type: ignore[no-untyped-def]
    """Takes off what a point has in all photos, and a photo in all points, by turns, in place.

    Args:
        values: [N] float64; point, photo: [N] int64.
        seen: [P] float64, observations of each point; held: [V] float64, of each photo, and what holds it at 0.
        rounds: of photos and then points; points come first once.
    """
    of_point, of_photo = np.empty(len(seen)), np.empty(len(held))
    for turn in range(rounds + 1):
        if turn > 0:
            of_photo[:] = 0.0
            for n in range(len(values)):
                of_photo[photo[n]] += values[n]
            for v in range(len(held)):
                of_photo[v] /= held[v]
            for n in range(len(values)):
                values[n] -= of_photo[photo[n]]
        of_point[:] = 0.0
        for n in range(len(values)):
            of_point[point[n]] += values[n]
        for p in range(len(seen)):
            if seen[p] > 0.0:
                of_point[p] /= seen[p]
        for n in range(len(values)):
            values[n] -= of_point[point[n]]
