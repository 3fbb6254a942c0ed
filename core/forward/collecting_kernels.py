"""The light of several frames collected on one sensor, forwards and back, in one pass each.

The curve between display values and linear light (`core.colour`) is read off a table: its power would cost as much as
the frames themselves. Between two entries the table is linear, which errs by less than 1e-7.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import inlined, kernel
from ..tone_curve import NEWTON

#: Entries of the table for display values 0 to 1; the power itself is taken above.
STEPS = 4096
KNEE, LINEAR_KNEE = np.float32(0.04045), np.float32(0.0031308)


@inlined
def decoded(value: Any, table: Any) -> Any:
    """Linear light of one display value; table: [STEPS + 2] of the curve."""
    if value <= KNEE:
        return value * np.float32(1 / 12.92)
    if value >= np.float32(1.0):
        return np.float32(((value + np.float32(0.055)) * np.float32(1 / 1.055)) ** np.float32(2.4))
    at = value * np.float32(STEPS)
    index = int(at)
    rest = at - np.float32(index)
    return table[index] + rest * (table[index + 1] - table[index])


@kernel
def collect(begin: int, end: int, frames: Any, weights: Any, table: Any, light: Any, shown: Any) -> None:
    """Items are rows of all channels: light [R, W] = the mean of frames [K, R, W], decoded; shown: the same encoded.

    weights: [K, R] shares of each row's light.
    """
    for row in range(begin, end):
        to, out = light[row], shown[row]
        to[:] = np.float32(0.0)
        for k in range(frames.shape[0]):
            source, weight = frames[k, row], weights[k, row]
            for x in range(to.shape[0]):
                to[x] += weight * decoded(source[x], table)
        for x in range(to.shape[0]):
            v = to[x]
            if v > LINEAR_KNEE:
                out[x] = np.float32(1.055) * v ** np.float32(1 / 2.4) - np.float32(0.055)
            else:
                out[x] = v * np.float32(12.92)


@kernel
def distribute(
    begin: int, end: int, upstream: Any, frames: Any, weights: Any, table: Any, light: Any, shown: Any, out: Any
) -> None:
    """Items are rows: out [K, R, W] = the gradient in each frame, given that in what they are collected to."""
    scale = np.empty(upstream.shape[1], np.float32)
    for row in range(begin, end):
        came, lit, seen = upstream[row], light[row], shown[row]
        for x in range(scale.shape[0]):
            if lit[x] > LINEAR_KNEE:
                scale[x] = came[x] * (seen[x] + np.float32(0.055)) / (np.float32(2.4) * lit[x])
            else:
                scale[x] = came[x] * np.float32(12.92)
        for k in range(frames.shape[0]):
            source, weight, to = frames[k, row], weights[k, row], out[k, row]
            for x in range(scale.shape[0]):
                v = source[x]
                if v > KNEE:
                    slope = np.float32(2.4) * decoded(v, table) / (v + np.float32(0.055))
                else:
                    slope = np.float32(1 / 12.92)
                to[x] = weight * scale[x] * slope


@inlined
def straightened(value: Any, toe: Any, shoulder: Any) -> Any:
    """`ToneCurve.undone` of one value."""
    inside = min(max(value, np.float32(0.0)), np.float32(1.0))
    rest, beyond = np.float32(1.0) - inside, value - inside
    ends = toe * min(beyond, np.float32(0.0)) + shoulder * max(beyond, np.float32(0.0))
    return value + inside * rest * (toe * rest - shoulder * inside) + ends


@inlined
def steepness(value: Any, toe: Any, shoulder: Any) -> Any:
    """`ToneCurve.slope` of one value."""
    inside = min(max(value, np.float32(0.0)), np.float32(1.0))
    low = (np.float32(1.0) - inside) * (np.float32(1.0) - np.float32(3.0) * inside)
    high = inside * (np.float32(3.0) * inside - np.float32(2.0))
    return np.float32(1.0) + toe * low + shoulder * high


@kernel
def collect_filed(
    begin: int,
    end: int,
    frames: Any,
    weights: Any,
    table: Any,
    toe: Any,
    shoulder: Any,
    light: Any,
    shown: Any,
    out: Any,
) -> None:
    """`collect` of frames that a camera filed by a curve of its own; out [R, W] = shown, as it files that."""
    srgb = np.empty(light.shape[1], np.float32)  # (a pass of its own fits vector registers, a table does not)
    for row in range(begin, end):
        to, plain = light[row], shown[row]
        to[:] = np.float32(0.0)
        for k in range(frames.shape[0]):
            source, weight = frames[k, row], weights[k, row]
            for x in range(to.shape[0]):
                srgb[x] = straightened(source[x], toe, shoulder)
            for x in range(to.shape[0]):
                to[x] += weight * decoded(srgb[x], table)
        for x in range(to.shape[0]):
            v = to[x]
            if v > LINEAR_KNEE:
                plain[x] = np.float32(1.055) * v ** np.float32(1 / 2.4) - np.float32(0.055)
            else:
                plain[x] = v * np.float32(12.92)
        file = out[row]
        for x in range(to.shape[0]):
            found = plain[x]
            for _ in range(NEWTON):
                found -= (straightened(found, toe, shoulder) - plain[x]) / steepness(found, toe, shoulder)
            file[x] = found


@kernel
def distribute_filed(
    begin: int,
    end: int,
    upstream: Any,
    frames: Any,
    weights: Any,
    table: Any,
    toe: Any,
    shoulder: Any,
    light: Any,
    shown: Any,
    file: Any,
    out: Any,
) -> None:
    """`distribute` behind `collect_filed`; file: [R, W] what that gave, in which upstream is."""
    scale, srgb = np.empty(upstream.shape[1], np.float32), np.empty(upstream.shape[1], np.float32)
    for row in range(begin, end):
        came, lit, seen = upstream[row], light[row], shown[row]
        for x in range(scale.shape[0]):
            steep = came[x] / steepness(file[row, x], toe, shoulder)
            if lit[x] > LINEAR_KNEE:
                scale[x] = steep * (seen[x] + np.float32(0.055)) / (np.float32(2.4) * lit[x])
            else:
                scale[x] = steep * np.float32(12.92)
        for k in range(frames.shape[0]):
            source, weight, to = frames[k, row], weights[k, row], out[k, row]
            for x in range(scale.shape[0]):
                srgb[x] = straightened(source[x], toe, shoulder)
            for x in range(scale.shape[0]):
                v = srgb[x]
                if v > KNEE:
                    slope = np.float32(2.4) * decoded(v, table) / (v + np.float32(0.055))
                else:
                    slope = np.float32(1 / 12.92)
                to[x] = weight * scale[x] * slope
            for x in range(scale.shape[0]):
                to[x] *= steepness(source[x], toe, shoulder)
