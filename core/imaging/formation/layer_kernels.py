"""What `layer_blur` does px by px, in one pass over rows: the light of layers before the blur, and their sum after it.

Of each layer the planes are colours times the share that it covers, and that share. Layer `j` hides `k` where it stands
at `front[k]` or behind in the list.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...colour import DECODING
from ...compiled import inlined, kernel

f32 = np.float32
_KNEE, _SLOPE, _OFFSET, _POWER = (f32(value) for value in DECODING)


@inlined
def decoded(value: Any) -> Any:
    """Linear light of a display value, as `colour.srgb_to_linear`."""
    if value > _KNEE:
        return ((value + _OFFSET) / (f32(1.0) + _OFFSET)) ** _POWER
    return value / _SLOPE


@inlined
def slope_of(value: Any, light: Any) -> Any:
    """Derivative of `decoded`, whose value is `light`."""
    return _POWER * light / (value + _OFFSET) if value > _KNEE else f32(1.0) / _SLOPE


@inlined
def see(shares: Any, front: Any, seen: Any) -> None:
    """seen [L, w]: how much of each layer is, by shares [L, w] that all cover."""
    count, width = shares.shape
    for k in range(count):
        for x in range(width):
            seen[k, x] = f32(1.0)
        for j in range(front[k], count):
            for x in range(width):
                seen[k, x] -= shares[j, x]
        for x in range(width):
            seen[k, x] = max(seen[k, x], f32(0.0))


@inlined
def hide(front: Any, seen: Any, in_seen: Any, in_shares: Any) -> None:
    """Adds to gradients in the shares [L, w] what those in `seen` say."""
    count, width = seen.shape
    for k in range(count):
        for j in range(front[k], count):
            for x in range(width):
                in_shares[j, x] -= in_seen[k, x] if seen[k, x] > f32(0.0) else f32(0.0)


@kernel
def light_of_layers(
    begin: int, end: int, planes: Any, image: Any, front: Any, least: Any, fewest: Any, light: Any, out: Any
) -> None:
    """Rows `begin` to `end` of what is to be blurred: out [L, 4, h, w].

    Args:
        planes: [L, 4, h, w]; image: [3, h, w] sRGB.
        least: share below which colours are not asked for; fewest: of a px that must be covered.
        light: [L, 3, h, w] output, linear light of the layers' colours.
    """
    count, _, _, width = planes.shape
    seen, total, norm = np.empty((count, width), f32), np.empty(width, f32), np.empty(width, f32)
    for y in range(begin, end):
        see(planes[:, 3, y], front, seen)
        norm[:] = 0
        for k in range(count):
            for x in range(width):
                norm[x] += seen[k, x] * planes[k, 3, y, x]
        for c in range(3):
            total[:] = 0
            for k in range(count):
                for x in range(width):
                    share = planes[k, 3, y, x]
                    found = decoded(planes[k, c, y, x] / max(share, least)) if share > f32(0.0) else f32(0.0)
                    light[k, c, y, x] = found
                    total[x] += seen[k, x] * share * found
            for x in range(width):
                total[x] = decoded(image[c, y, x]) - total[x] / max(norm[x], fewest)
            for k in range(count):
                for x in range(width):
                    out[k, c, y, x] = planes[k, 3, y, x] * (light[k, c, y, x] + seen[k, x] * total[x])
        for k in range(count):
            out[k, 3, y] = planes[k, 3, y]


@kernel
def light_of_layers_back(
    begin: int,
    end: int,
    planes: Any,
    image: Any,
    front: Any,
    least: Any,
    fewest: Any,
    light: Any,
    in_planes: Any,
    in_image: Any,
) -> None:
    """Gradients in the planes [L, 4, h, w] in the place of those in `light_of_layers`' output, and in the image."""
    count, _, _, width = planes.shape
    seen, in_seen = np.empty((count, width), f32), np.empty((count, width), f32)
    in_share = np.empty((count, width), f32)
    norm, total, more, in_total = np.empty(width, f32), np.empty(width, f32), np.empty(width, f32), np.empty(width, f32)
    in_norm = np.empty(width, f32)
    for y in range(begin, end):
        see(planes[:, 3, y], front, seen)
        norm[:] = 0
        in_norm[:] = 0
        for k in range(count):
            for x in range(width):
                norm[x] += seen[k, x] * planes[k, 3, y, x]
                in_share[k, x] = in_planes[k, 3, y, x]
                in_seen[k, x] = 0
        for c in range(3):
            total[:] = 0
            more[:] = 0  # (first the gradient in what is added to the seen ones)
            for k in range(count):
                for x in range(width):
                    share = planes[k, 3, y, x]
                    total[x] += seen[k, x] * share * light[k, c, y, x]
                    more[x] += seen[k, x] * share * in_planes[k, c, y, x]
            for x in range(width):
                divisor = max(norm[x], fewest)
                value = decoded(image[c, y, x])
                in_image[c, y, x] = more[x] * slope_of(image[c, y, x], value)
                in_total[x] = -more[x] / divisor
                mean = total[x] / divisor
                in_norm[x] -= in_total[x] * mean if norm[x] >= fewest else f32(0.0)
                more[x] = value - mean
            for k in range(count):
                for x in range(width):
                    share, own, back = planes[k, 3, y, x], light[k, c, y, x], in_planes[k, c, y, x]
                    in_seen[k, x] += share * (more[x] * back + own * in_total[x])
                    in_share[k, x] += back * (own + seen[k, x] * more[x]) + seen[k, x] * own * in_total[x]
                    divisor = max(share, least)
                    colour = planes[k, c, y, x] / divisor
                    in_colour = share * (back + seen[k, x] * in_total[x]) * slope_of(colour, own) / divisor
                    in_planes[k, c, y, x] = in_colour if share > f32(0.0) else f32(0.0)
                    in_share[k, x] -= in_colour * colour if share >= least else f32(0.0)
        for k in range(count):
            for x in range(width):
                in_share[k, x] += seen[k, x] * in_norm[x]
                in_seen[k, x] += planes[k, 3, y, x] * in_norm[x]
        hide(front, seen, in_seen, in_share)
        for k in range(count):
            in_planes[k, 3, y] = in_share[k]


@kernel
def sum_of_layers(begin: int, end: int, planes: Any, front: Any, fewest: Any, out: Any) -> None:
    """Rows of the light [3, h, w] that blurred layers [L, 4, h, w] let through, each hidden by those in front of it."""
    count, _, _, width = planes.shape
    seen, norm = np.empty((count, width), f32), np.empty(width, f32)
    for y in range(begin, end):
        see(planes[:, 3, y], front, seen)
        norm[:] = 0
        for k in range(count):
            for x in range(width):
                norm[x] += seen[k, x] * planes[k, 3, y, x]
        for c in range(3):
            out[c, y] = 0
            for k in range(count):
                for x in range(width):
                    out[c, y, x] += seen[k, x] * planes[k, c, y, x]
            for x in range(width):
                out[c, y, x] /= max(norm[x], fewest)


@kernel
def sum_of_layers_back(begin: int, end: int, planes: Any, front: Any, fewest: Any, light: Any, came: Any) -> None:
    """Gradients in the planes [L, 4, h, w], in their own place, given the light [3, h, w] and what came in it."""
    count, _, _, width = planes.shape
    seen, in_seen = np.empty((count, width), f32), np.empty((count, width), f32)
    in_share, norm, in_norm = np.empty((count, width), f32), np.empty(width, f32), np.empty(width, f32)
    for y in range(begin, end):
        see(planes[:, 3, y], front, seen)
        norm[:] = 0
        in_norm[:] = 0
        for k in range(count):
            for x in range(width):
                norm[x] += seen[k, x] * planes[k, 3, y, x]
                in_seen[k, x] = 0
        for c in range(3):
            for x in range(width):
                in_norm[x] -= came[c, y, x] * light[c, y, x] / norm[x] if norm[x] >= fewest else f32(0.0)
            for k in range(count):
                for x in range(width):
                    back = came[c, y, x] / max(norm[x], fewest)
                    in_seen[k, x] += planes[k, c, y, x] * back
                    planes[k, c, y, x] = seen[k, x] * back
        for k in range(count):
            for x in range(width):
                in_share[k, x] = seen[k, x] * in_norm[x]
                in_seen[k, x] += planes[k, 3, y, x] * in_norm[x]
        hide(front, seen, in_seen, in_share)
        for k in range(count):
            planes[k, 3, y] = in_share[k]
