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
