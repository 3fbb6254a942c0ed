"""What a step of a path asks of a photo, row by row: how it changes, and the sums over its px.

They mirror `Along.in_torch`, `slopes.change_by` and `SeenPx.sums_in_torch`. Each frame's light is read off the
table of the forward pass (`forward.collecting_kernels`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import inlined, kernel
from ...forward.collecting_kernels import KNEE, LINEAR_KNEE, decoded, steepness, straightened

f32 = np.float32


@inlined
def decoding(srgb: Any, light: Any) -> Any:
    """Derivative of the light by sRGB's own value (`core.colour.decoding_derivative`)."""
    if srgb > KNEE:
        return f32(2.4) * light / (srgb + f32(0.055))
    return f32(1 / 12.92)


@inlined
def encoding(light: Any, srgb: Any) -> Any:
    """Derivative of sRGB's own value by the light (`core.colour.encoding_derivative`)."""
    if light > LINEAR_KNEE:
        return (srgb + f32(0.055)) / (f32(2.4) * light)
    return f32(12.92)


@kernel
def slope_rows(
    begin: int,
    end: int,
    frames: Any,
    photo: Any,
    at: Any,
    shares: Any,
    curve: Any,
    table: Any,
    right: Any,
    down: Any,
    by_curve: Any,
) -> None:
    """Items are rows that a step looks at, of all channels.

    Args:
        frames: [T, 3, H + 2m, W + 2m] as they were filed; photo: [3, H, W] as the twin shows it, filed.
        at: [4] int64: the first row and column of the photo that are looked at, every how many, and m.
        shares: [M + 1, T, h] of frame t in part m of the path, in each row; those of part 0 are of the photo's light.
        curve: [2] the camera's toe and shoulder; table: of the light of display values.
        right, down: [M + 1, 3, h, w] of the photo by a px's shift of each part.
        by_curve: [2, 3, h, w] of the photo by toe and shoulder.
    """
    parts, count, height = shares.shape
    width = right.shape[3]
    toe, shoulder, first, every, m = curve[0], curve[1], at[1], at[2], at[3]
    # (Passes of their own fit vector registers, a table does not.)
    values, srgb, slope = np.empty(width, f32), np.empty(width, f32), np.empty(width, f32)
    across, along = np.empty(width, f32), np.empty(width, f32)
    for item in range(begin, end):
        c, row = item // height, item % height
        y = at[0] + row * every
        for part in range(parts):
            right[part, c, row, :] = f32(0)
            down[part, c, row, :] = f32(0)
        low, high = by_curve[0, c, row], by_curve[1, c, row]
        low[:] = f32(0)
        high[:] = f32(0)
        for t in range(count):
            above, here, below = frames[t, c, m + y - 1], frames[t, c, m + y], frames[t, c, m + y + 1]
            share = shares[0, t, row]
            for x in range(width):
                k = m + first + x * every
                values[x], across[x], along[x] = here[k], here[k + 1] - here[k - 1], below[k] - above[k]
            for x in range(width):
                srgb[x] = straightened(values[x], toe, shoulder)
            for x in range(width):
                slope[x] = decoding(srgb[x], decoded(srgb[x], table))
            for x in range(width):
                half = f32(0.5) * slope[x] * steepness(values[x], toe, shoulder)
                across[x] *= half
                along[x] *= half
            for x in range(width):
                inside = min(max(values[x], f32(0)), f32(1))
                rest, part_of_light = f32(1) - inside, share * slope[x]
                low[x] += part_of_light * inside * rest * rest
                high[x] -= part_of_light * inside * inside * rest
            for part in range(parts):
                share, to_right, to_down = shares[part, t, row], right[part, c, row], down[part, c, row]
                for x in range(width):
                    to_right[x] += share * across[x]
                    to_down[x] += share * along[x]
        for x in range(width):
            v = photo[c, y, first + x * every]
            lit = straightened(v, toe, shoulder)
            light, steep = decoded(lit, table), steepness(v, toe, shoulder)
            encode = encoding(light, lit) / steep
            for part in range(parts):
                right[part, c, row, x] *= encode
                down[part, c, row, x] *= encode
            inside = min(max(v, f32(0)), f32(1))
            rest, own = f32(1) - inside, decoding(lit, light)
            low[x] = (low[x] / own - inside * rest * rest) / steep
            high[x] = (high[x] / own + inside * inside * rest) / steep


@kernel
def change_rows(
    begin: int, end: int, frames: Any, photo: Any, at: Any, used: Any, shares: Any, curve: Any, table: Any, out: Any
) -> None:
    """Items are rows that a step looks at, of all channels: out [3, h, w] = what a photo changes by with frames' light.

    Args:
        used: [K] int64 which frames; shares: [K, h] of their light in each row; others as of `slope_rows`.
    """
    height, width = shares.shape[1], out.shape[2]
    toe, shoulder, first, every, m = curve[0], curve[1], at[1], at[2], at[3]
    srgb = np.empty(width, f32)
    for item in range(begin, end):
        c, row = item // height, item % height
        y, to = at[0] + row * every, out[c, row]
        to[:] = f32(0)
        for k in range(used.shape[0]):
            here, share = frames[used[k], c, m + y], shares[k, row]
            for x in range(width):
                srgb[x] = straightened(here[m + first + x * every], toe, shoulder)
            for x in range(width):
                to[x] += share * decoded(srgb[x], table)
        for x in range(width):
            v = photo[c, y, first + x * every]
            lit = straightened(v, toe, shoulder)
            to[x] *= encoding(decoded(lit, table), lit) / steepness(v, toe, shoulder)


@kernel
def sum_rows(
    begin: int, end: int, right: Any, down: Any, flow: Any, beside: Any, rest: Any, weight: Any, out: Any
) -> None:
    """Items are rows: out [h, N, N] = the upper halves of each row's sums of w a a^T.

    a: [N] a px's slopes by the path's coefficients, by what else is asked, and what is left of the photo.

    Args:
        right, down: [M + 1, 3, h, w] of the photo by a px's shift of each part of the path.
        flow: [2, 6, h, w] px to the right, and down, by which each axis moves what is seen.
        beside: [E, 3, h, w] of the photo by what else is asked; rest, weight: [3, h, w].
    """
    parts, others, width, size = right.shape[0], beside.shape[0], right.shape[3], out.shape[1]
    values, weighted = np.empty((size, width), f32), np.empty((size, width), f32)
    for row in range(begin, end):
        sums = out[row]
        sums[:] = f32(0)
        for c in range(3):
            for part in range(parts):
                to_right, to_down = right[part, c, row], down[part, c, row]
                for axis in range(6):
                    du, dv, to = flow[0, axis, row], flow[1, axis, row], values[6 * part + axis]
                    for x in range(width):
                        to[x] = -(to_right[x] * du[x] + to_down[x] * dv[x])
            for other in range(others):
                values[6 * parts + other] = beside[other, c, row]
            values[size - 1] = rest[c, row]
            w = weight[c, row]
            for p in range(size):
                to, value = weighted[p], values[p]
                for x in range(width):
                    to[x] = value[x] * w[x]
            for p in range(size):
                value = weighted[p]
                for q in range(p, size):
                    other_value, total = values[q], f32(0)
                    for x in range(width):
                        total += value[x] * other_value[x]
                    sums[p, q] += total
