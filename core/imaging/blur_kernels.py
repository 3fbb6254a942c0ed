"""Compiled blurs: a symmetric separable one and a direct one, each with its adjoint.

Rows are worked on whole: the vertical pass of one output row goes into a line that stays in the
first-level cache, and the horizontal pass reads it from there. Taps come in pairs at equal distance
from the centre, three pairs to a sweep, which LLVM turns into vector code (more arrays in one loop
exceed its budget of overlap checks).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import inlined, kernel

#: Pairs of taps in one sweep over a row; half taps are padded with zeros to 1 + a multiple of it.
PAIRS = 3


@inlined
def _scaled(out: Any, a: Any, k: Any) -> None:
    for x in range(out.shape[0]):
        out[x] = k * a[x]


@inlined
def _add_scaled(out: Any, a: Any, k: Any) -> None:
    for x in range(out.shape[0]):
        out[x] += k * a[x]


@inlined
def _add_pairs(
    out: Any, a0: Any, b0: Any, a1: Any, b1: Any, a2: Any, b2: Any, k0: Any, k1: Any, k2: Any
) -> None:
    for x in range(out.shape[0]):
        out[x] += k0 * (a0[x] + b0[x]) + k1 * (a1[x] + b1[x]) + k2 * (a2[x] + b2[x])


@inlined
def _blur_line(line: Any, out: Any, half: Any) -> None:
    """out[x] = sum_t half[|t|] line[x + t + r]; line is 2 r longer than out."""
    n = out.shape[0]
    r = half.shape[0] - 1
    _scaled(out, line[r : r + n], half[0])
    for t in range(1, r + 1, 3):
        _add_pairs(
            out,
            line[r - t : r - t + n], line[r + t : r + t + n],
            line[r - t - 1 : r - t - 1 + n], line[r + t + 1 : r + t + 1 + n],
            line[r - t - 2 : r - t - 2 + n], line[r + t + 2 : r + t + 2 + n],
            half[t], half[t + 1], half[t + 2],
        )  # fmt: skip


@inlined
def _clamped(row: int, rows: int) -> int:
    return min(max(row, 0), rows - 1)


@kernel
def separable_apply(
    begin: int, end: int, source: Any, out: Any, half_v: Any, half_h: Any, margin: int
) -> None:
    """Items are rows of all channels. source [C, H + 2m, W + 2m], out [C, H, W]."""
    rows, columns = source.shape[1], source.shape[2]
    height, width = out.shape[1], out.shape[2]
    rv, rh = half_v.shape[0] - 1, half_h.shape[0] - 1
    line = np.empty(width + 2 * rh, source.dtype)
    first = max(margin - rh, 0)
    last = min(margin + width + rh, columns)
    offset = first - (margin - rh)
    inner = line[offset : offset + last - first]
    for item in range(begin, end):
        c, y = item // height, item % height + margin
        _scaled(inner, source[c, y, first:last], half_v[0])
        for t in range(1, rv + 1, 3):
            _add_pairs(
                inner,
                source[c, _clamped(y - t, rows), first:last],
                source[c, _clamped(y + t, rows), first:last],
                source[c, _clamped(y - t - 1, rows), first:last],
                source[c, _clamped(y + t + 1, rows), first:last],
                source[c, _clamped(y - t - 2, rows), first:last],
                source[c, _clamped(y + t + 2, rows), first:last],
                half_v[t], half_v[t + 1], half_v[t + 2],
            )  # fmt: skip
        line[:offset] = line[offset]
        line[offset + last - first :] = line[offset + last - first - 1]
        _blur_line(line, out[c, y - margin], half_h)


@inlined
def _inside(image: Any, c: int, y: int, blank: Any) -> Any:
    if y < 0 or y >= image.shape[1]:
        return blank
    return image[c, y]


@kernel
def separable_adjoint(
    begin: int, end: int, image: Any, out: Any, half_v: Any, half_h: Any, margin: int
) -> None:
    """Items are rows of all channels of out [C, H + 2m, W + 2m]; image [C, H, W].

    Beyond the margin the forward blur repeats the edge, so the edge here gathers what the blur of
    the zero-extended image would send beyond it.
    """
    height, width = image.shape[1], image.shape[2]
    rows, columns = out.shape[1], out.shape[2]
    rv, rh = half_v.shape[0] - 1, half_h.shape[0] - 1
    beyond_v, beyond_h = max(0, rv - margin), max(0, rh - margin)
    blank = np.zeros(width, image.dtype)
    line = np.zeros(columns + 2 * beyond_h + 2 * rh, image.dtype)
    start = beyond_h + margin + rh
    inner = line[start : start + width]
    wide = np.empty(columns + 2 * beyond_h, image.dtype)
    for item in range(begin, end):
        c, i = item // rows, item % rows
        y = i - margin
        if beyond_v > 0 and (i == 0 or i == rows - 1):
            inner[:] = 0
            top = y - beyond_v if i == 0 else y
            bottom = y + beyond_v if i == rows - 1 else y
            for row in range(max(0, top - rv), min(height, bottom + rv + 1)):
                weight = half_v[0] - half_v[0]
                for virtual in range(max(top, row - rv), min(bottom, row + rv) + 1):
                    weight += half_v[abs(virtual - row)]
                _add_scaled(inner, image[c, row], weight)
        else:
            _scaled(inner, _inside(image, c, y, blank), half_v[0])
            for t in range(1, rv + 1, 3):
                if y + t + 2 < 0 or y - t - 2 >= height or (y + t < -2 and y - t < 0):
                    continue
                _add_pairs(
                    inner,
                    _inside(image, c, y - t, blank), _inside(image, c, y + t, blank),
                    _inside(image, c, y - t - 1, blank), _inside(image, c, y + t + 1, blank),
                    _inside(image, c, y - t - 2, blank), _inside(image, c, y + t + 2, blank),
                    half_v[t], half_v[t + 1], half_v[t + 2],
                )  # fmt: skip
        if beyond_h == 0:
            _blur_line(line, out[c, i], half_h)
        else:
            _blur_line(line, wide, half_h)
            out[c, i] = wide[beyond_h : beyond_h + columns]
            for x in range(beyond_h):
                out[c, i, 0] += wide[x]
                out[c, i, columns - 1] += wide[beyond_h + columns + x]


@inlined
def _add_four(out: Any, a: Any, b: Any, c: Any, d: Any, k0: Any, k1: Any, k2: Any, k3: Any) -> None:
    for x in range(out.shape[0]):
        out[x] += k0 * a[x] + k1 * b[x] + k2 * c[x] + k3 * d[x]


@kernel
def correlate(begin: int, end: int, source: Any, out: Any, taps: Any) -> None:
    """Items are rows of all channels: out[c, y, x] = sum taps[j, i] source[c, y + j, x + i].

    source [C, H + K - 1, W + L - 1], out [C, H, W], taps [K, L] with L a multiple of 4 (padded with
    zeros, and source with as many columns).
    """
    height, width = out.shape[1], out.shape[2]
    for item in range(begin, end):
        c, y = item // height, item % height
        line = out[c, y]
        line[:] = 0
        for j in range(taps.shape[0]):
            row = source[c, y + j]
            for i in range(0, taps.shape[1], 4):
                _add_four(
                    line,
                    row[i : i + width], row[i + 1 : i + 1 + width],
                    row[i + 2 : i + 2 + width], row[i + 3 : i + 3 + width],
                    taps[j, i], taps[j, i + 1], taps[j, i + 2], taps[j, i + 3],
                )  # fmt: skip
