"""Depth between trusted px, along rows and along columns: inverse depth is linear in the image on a plane."""

from __future__ import annotations

from ..compiled import kernel


@kernel
def between(begin, end, depth, wanted, deepest, guess):  # type: ignore[no-untyped-def]
    """For each wanted px without a depth: the one between the nearest px of its row that have one, on both sides.

    Args:
        depth: [H, W] float32, 0 where there is none; wanted: [H, W] bool.
        deepest: ratio of the two sides' depths above which they are not of one surface.
        guess: [H, W] float32 output, inverse depth; 0 where there is none. One row is one item.
    """
    width = depth.shape[1]
    for y in range(begin, end):
        left = -1
        for x in range(width):
            guess[y, x] = 0.0
            if depth[y, x] <= 0:
                continue
            if left >= 0 and x > left + 1:
                a, b = depth[y, left], depth[y, x]
                if max(a, b) <= deepest * min(a, b):
                    for i in range(left + 1, x):
                        if wanted[y, i]:
                            share = (i - left) / (x - left)
                            guess[y, i] = (1.0 - share) / a + share / b
            left = x
