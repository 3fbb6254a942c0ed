"""What a layered blur does px by px, in one pass each.

A level's weight at variance v is max(0, min(r0 + r1 v, f0 + f1 v)): a tent over v, or 1 beyond where the ladder ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import kernel


@kernel
def weighed(begin: int, end: int, light: Any, variance: Any, r0: Any, r1: Any, f0: Any, f1: Any, out: Any) -> None:
    """Items are rows: out [C + 1, h, w] = the level's share of light [C, h, w], and the weights last."""
    channels = light.shape[0]
    for y in range(begin, end):
        weight, v = out[channels, y], variance[y]
        for x in range(v.shape[0]):
            weight[x] = max(np.float32(0), min(r0 + r1 * v[x], f0 + f1 * v[x]))
        for c in range(channels):
            source, to = light[c, y], out[c, y]
            for x in range(v.shape[0]):
                to[x] = weight[x] * source[x]


@kernel
def gathered(
    begin: int,
    end: int,
    back: Any,
    light: Any,
    variance: Any,
    r0: Any,
    r1: Any,
    f0: Any,
    f1: Any,
    gradient: Any,
    in_variance: Any,
) -> None:
    """Items are rows: adds a level's part to the gradients in light [C, h, w] and in variance [h, w].

    back: [C + 1, h, w] what came back through the level's blur: of every channel, and of all together last.
    """
    channels = light.shape[0]
    share = np.empty(light.shape[2], np.float32)
    for y in range(begin, end):
        v, derivative = variance[y], in_variance[y]
        for x in range(v.shape[0]):
            share[x] = -back[channels, y, x]
        for c in range(channels):
            came, source, to = back[c, y], light[c, y], gradient[c, y]
            for x in range(v.shape[0]):
                share[x] += came[x] * source[x]
                to[x] += max(np.float32(0), min(r0 + r1 * v[x], f0 + f1 * v[x])) * came[x]
        for x in range(v.shape[0]):
            rising, falling = r0 + r1 * v[x], f0 + f1 * v[x]
            side = r1 if rising < falling else f1
            derivative[x] += (side if min(rising, falling) >= np.float32(0) else np.float32(0)) * share[x]


@kernel
def returned(begin: int, end: int, together: Any, seen: Any, came: Any) -> None:
    """Items are rows: came [C + 1, h, w] = the share seen [h, w] of together [C + 1, h, w], the last one negative."""
    last = together.shape[0] - 1
    for y in range(begin, end):
        share = seen[y]
        for c in range(last + 1):
            sign = np.float32(-1) if c == last else np.float32(1)
            source, to = together[c, y], came[c, y]
            for x in range(share.shape[0]):
                to[x] = sign * (share[x] * source[x])


@kernel
def returned_through(
    begin: int, end: int, together: Any, seen: Any, planes: Any, part: Any, hides: Any, came: Any
) -> None:
    """`returned` to a level that hides others: planes [C + 1, h, w] of the next one of them, of which a part [h, w] is
    seen. hides [h, w], what the hidden ones are covered by, gets this level's share, and came the whole of it.
    """
    last = together.shape[0] - 1
    mine = np.empty(together.shape[2], np.float32)
    for y in range(begin, end):
        share, visible, covered = seen[y], part[y], hides[y]
        mine[:] = 0
        for c in range(last + 1):
            source, behind, to = together[c, y], planes[c, y], came[c, y]
            for x in range(share.shape[0]):
                mine[x] += source[x] * behind[x]
                to[x] = share[x] * source[x]
        to = came[last, y]
        for x in range(share.shape[0]):
            covered[x] += mine[x] if visible[x] > 0 else np.float32(0)
            to[x] = covered[x] - to[x]
