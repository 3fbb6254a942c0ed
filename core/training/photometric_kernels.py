"""Compiled mean absolute error and SSIM, value and gradient.

Work goes tile by tile: STRIP columns, BAND rows, one channel. Rows of a tile lie STRIDE floats apart,
a constant, so that LLVM sees at compile time that an 11-tap sweep reads one array, and needs no
overlap checks. Photo and render count as black beyond the frame, as in 3D Gaussian splatting.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..compiled import inlined, kernel

#: SSIM's constants (Wang et al. 2004) for values in [0, 1].
C1 = 0.01**2
C2 = 0.03**2
#: Reach of the window to either side: 11 x 11 px with a standard deviation of 1.5 px.
REACH = 5
_weights = [math.exp(-0.5 * (t / 1.5) ** 2) for t in range(REACH + 1)]
_total = _weights[0] + 2 * sum(_weights[1:])
K0, K1, K2, K3, K4, K5 = (np.float32(w / _total) for w in _weights)

#: Columns and rows of a tile: three fields of 11 rows fill half of the first-level cache.
STRIP = 128
BAND = 32
STRIDE = np.uint64(STRIP + 16)
_FIELD = np.uint64((BAND + 2 * REACH) * (STRIP + 16))
_S = STRIDE

_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_HALF = np.float32(0.5)
_C1 = np.float32(C1)
_C2 = np.float32(C2)
_ZERO = np.float32(0.0)


@inlined
def _across(line: Any, out: Any, o: Any) -> None:
    """out[o + x] = sum_t K[|t|] line[x + 5 + t] over one strip."""
    for i in range(STRIP):
        x = np.uint64(i)
        out[o + x] = (
            K5 * (line[x] + line[x + np.uint64(10)])
            + K4 * (line[x + np.uint64(1)] + line[x + np.uint64(9)])
            + K3 * (line[x + np.uint64(2)] + line[x + np.uint64(8)])
            + K2 * (line[x + np.uint64(3)] + line[x + np.uint64(7)])
            + K1 * (line[x + np.uint64(4)] + line[x + np.uint64(6)])
            + K0 * line[x + np.uint64(5)]
        )


@inlined
def _down(field: Any, o: Any, out: Any) -> None:
    """out[x] = sum_t K[|t|] field[row + 5 + t, x]; o is the offset of `row` in the flat field."""
    for i in range(STRIP):
        x = o + np.uint64(i)
        out[np.uint64(i)] = (
            K5 * (field[x] + field[x + np.uint64(10) * _S])
            + K4 * (field[x + _S] + field[x + np.uint64(9) * _S])
            + K3 * (field[x + np.uint64(2) * _S] + field[x + np.uint64(8) * _S])
            + K2 * (field[x + np.uint64(3) * _S] + field[x + np.uint64(7) * _S])
            + K1 * (field[x + np.uint64(4) * _S] + field[x + np.uint64(6) * _S])
            + K0 * field[x + np.uint64(5) * _S]
        )


@inlined
def _product(a: Any, b: Any, out: Any) -> None:
    for i in range(STRIP + 2 * REACH):
        x = np.uint64(i)
        out[x] = a[x] * b[x]


@kernel
def window_means(begin: int, end: int, image: Any, mean: Any, square: Any) -> None:
    """Items are tiles: windowed mean of image and of its square, all [C, H, W] float32."""
    _, height, width = image.shape
    strips, bands = -(-width // STRIP), -(-height // BAND)
    line = np.zeros(STRIP + 2 * REACH, np.float32)
    squares = np.zeros(STRIP + 2 * REACH, np.float32)
    fields = np.zeros(2 * _FIELD, np.float32)
    first, second = fields[:_FIELD], fields[_FIELD:]
    out = np.zeros(STRIP, np.float32)
    for item in range(begin, end):
        c, tile = item // (strips * bands), item % (strips * bands)
        top, left = tile // strips * BAND, tile % strips * STRIP
        columns, rows = min(STRIP, width - left), min(BAND, height - top)
        start, stop = max(0, left - REACH), min(width, left + STRIP + REACH)
        shift = start - left + REACH
        for j in range(rows + 2 * REACH):
            y = top + j - REACH
            o = np.uint64(j) * STRIDE
            line[:] = _ZERO
            if 0 <= y < height:
                line[shift : shift + stop - start] = image[c, y, start:stop]
            _product(line, line, squares)
            _across(line, first, o)
            _across(squares, second, o)
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, out)
            mean[c, top + j, left : left + columns] = out[:columns]
            _down(second, o, out)
            square[c, top + j, left : left + columns] = out[:columns]


@kernel
def similarity(
    begin: int,
    end: int,
    image: Any,
    photo: Any,
    valid: Any,
    masked: bool,
    photo_mean: Any,
    photo_square: Any,
    slopes: Any,
    sums: Any,
) -> None:
    """Items are tiles: sums[item, 0] += SSIM over valid px, and its derivatives.

    image, photo, valid, photo_mean, photo_square: [C, H, W] float32. slopes: [3, C, H, W], the
    derivatives of SSIM with respect to the windowed means of x, x^2 and x y, 0 where not valid.
    """
    _, height, width = image.shape
    strips, bands = -(-width // STRIP), -(-height // BAND)
    lines = np.zeros((4, STRIP + 2 * REACH), np.float32)
    a, b, aa, ab = lines[0], lines[1], lines[2], lines[3]
    fields = np.zeros(3 * _FIELD, np.float32)
    first, second, third = fields[:_FIELD], fields[_FIELD : 2 * _FIELD], fields[2 * _FIELD :]
    out = np.zeros((3, STRIP), np.float32)
    for item in range(begin, end):
        c, tile = item // (strips * bands), item % (strips * bands)
        top, left = tile // strips * BAND, tile % strips * STRIP
        columns, rows = min(STRIP, width - left), min(BAND, height - top)
        start, stop = max(0, left - REACH), min(width, left + STRIP + REACH)
        shift = start - left + REACH
        a[:] = _ZERO
        b[:] = _ZERO
        for j in range(rows + 2 * REACH):
            y = top + j - REACH
            o = np.uint64(j) * STRIDE
            if y < 0 or y >= height:
                first[o : o + STRIDE] = _ZERO
                second[o : o + STRIDE] = _ZERO
                third[o : o + STRIDE] = _ZERO
                continue
            b[shift : shift + stop - start] = photo[c, y, start:stop]
            if masked:
                row, other, weight = image[c, y, start:stop], photo[c, y, start:stop], valid[c, y, start:stop]
                inner = a[shift : shift + stop - start]
                for x in range(inner.shape[0]):
                    inner[x] = row[x] if weight[x] > _ZERO else other[x]
            else:
                a[shift : shift + stop - start] = image[c, y, start:stop]
            _product(a, a, aa)
            _product(a, b, ab)
            _across(a, first, o)
            _across(aa, second, o)
            _across(ab, third, o)
        total = 0.0
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, out[0])
            _down(second, o, out[1])
            _down(third, o, out[2])
            total += _similarity_row(
                out[0, :columns], out[1, :columns], out[2, :columns],
                photo_mean[c, top + j, left : left + columns],
                photo_square[c, top + j, left : left + columns],
                slopes[0, c, top + j, left : left + columns],
                slopes[1, c, top + j, left : left + columns],
                slopes[2, c, top + j, left : left + columns],
                valid[c, top + j, left : left + columns],
                masked,
                columns,
            )  # fmt: skip
        sums[item, 0] = total


@inlined
def _similarity_row(
    mean: Any, square: Any, cross: Any, other: Any, other_square: Any,
    slope_mean: Any, slope_square: Any, slope_cross: Any, weight: Any, masked: bool, columns: int,
) -> Any:  # fmt: skip
    """Sum of SSIM over one row of a tile. Derivatives are written over `mean`, `square`, `cross` first."""
    total = _ZERO
    for x in range(columns):
        m, n = mean[x], other[x]
        variance = max(square[x] - m * m, _ZERO)
        other_variance = max(other_square[x] - n * n, _ZERO)
        # Rounding must not push the correlation of flat windows above 1.
        covariance = min(cross[x] - m * n, _HALF * (variance + other_variance))
        top_mean, top_variance = _TWO * m * n + _C1, _TWO * covariance + _C2
        below_mean, below_variance = m * m + n * n + _C1, variance + other_variance + _C2
        inverse = _ONE / (below_mean * below_variance)
        value = top_mean * top_variance * inverse
        by_variance = value * below_mean * inverse
        mean[x] = _TWO * (
            n * (top_variance - top_mean) * inverse - m * value * below_variance * inverse + m * by_variance
        )
        square[x] = -by_variance
        cross[x] = _TWO * top_mean * inverse
        if masked:
            w = weight[x]
            mean[x] *= w
            square[x] *= w
            cross[x] *= w
            total += value * w
        else:
            total += value
    slope_mean[:] = mean
    slope_square[:] = square
    slope_cross[:] = cross
    return total


@kernel
def gradient(
    begin: int,
    end: int,
    image: Any,
    photo: Any,
    valid: Any,
    masked: bool,
    slopes: Any,
    error_weight: Any,
    similarity_weight: Any,
    out: Any,
    sums: Any,
) -> None:
    """Items are tiles: sums[item, 1] = sum of |x - y| over valid px; out [C, H, W] = the loss's gradient.

    error_weight and similarity_weight are what one px of either term weighs in the loss.
    """
    _, height, width = image.shape
    strips, bands = -(-width // STRIP), -(-height // BAND)
    line = np.zeros(STRIP + 2 * REACH, np.float32)
    fields = np.zeros(3 * _FIELD, np.float32)
    first, second, third = fields[:_FIELD], fields[_FIELD : 2 * _FIELD], fields[2 * _FIELD :]
    lines = np.zeros((3, STRIP), np.float32)
    for item in range(begin, end):
        c, tile = item // (strips * bands), item % (strips * bands)
        top, left = tile // strips * BAND, tile % strips * STRIP
        columns, rows = min(STRIP, width - left), min(BAND, height - top)
        start, stop = max(0, left - REACH), min(width, left + STRIP + REACH)
        shift = start - left + REACH
        line[:] = _ZERO
        for j in range(rows + 2 * REACH):
            y = top + j - REACH
            o = np.uint64(j) * STRIDE
            if y < 0 or y >= height:
                first[o : o + STRIDE] = _ZERO
                second[o : o + STRIDE] = _ZERO
                third[o : o + STRIDE] = _ZERO
                continue
            line[shift : shift + stop - start] = slopes[0, c, y, start:stop]
            _across(line, first, o)
            line[shift : shift + stop - start] = slopes[1, c, y, start:stop]
            _across(line, second, o)
            line[shift : shift + stop - start] = slopes[2, c, y, start:stop]
            _across(line, third, o)
        total = 0.0
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, lines[0])
            _down(second, o, lines[1])
            _down(third, o, lines[2])
            total += _gradient_row(
                lines[0, :columns], lines[1, :columns], lines[2, :columns],
                image[c, top + j, left : left + columns],
                photo[c, top + j, left : left + columns],
                valid[c, top + j, left : left + columns],
                masked, error_weight, similarity_weight,
                out[c, top + j, left : left + columns],
            )  # fmt: skip
        sums[item, 1] = total


@inlined
def _gradient_row(
    by_mean: Any, by_square: Any, by_cross: Any, row: Any, other: Any, weight: Any, masked: bool,
    error_weight: Any, similarity_weight: Any, out: Any,
) -> Any:  # fmt: skip
    total = _ZERO
    if masked:
        for x in range(out.shape[0]):
            difference = row[x] - other[x]
            sign = error_weight if difference > _ZERO else (-error_weight if difference < _ZERO else _ZERO)
            by_window = by_mean[x] + _TWO * row[x] * by_square[x] + other[x] * by_cross[x]
            # Selected rather than multiplied: the render may hold NaN where it does not count.
            out[x] = sign - similarity_weight * by_window if weight[x] > _ZERO else _ZERO
            total += abs(difference) if weight[x] > _ZERO else _ZERO
        return total
    for x in range(out.shape[0]):
        difference = row[x] - other[x]
        sign = error_weight if difference > _ZERO else (-error_weight if difference < _ZERO else _ZERO)
        by_window = by_mean[x] + _TWO * row[x] * by_square[x] + other[x] * by_cross[x]
        out[x] = sign - similarity_weight * by_window
        total += abs(difference)
    return total
