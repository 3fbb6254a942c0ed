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

#: Columns and rows of a tile: 11 rows of three fields fit the first-level cache, and 800 x 533 px and
#: its half divide with little waste.
STRIP = 208
BAND = 54
STRIDE = np.uint64(STRIP + 16)
_FIELD = np.uint64((BAND + 2 * REACH) * (STRIP + 16))
_S = STRIDE

#: Offsets of rows that lie STRIP floats apart.
_ROW1, _ROW2, _ROW3, _ROW4, _ROW5 = (np.uint64(k * STRIP) for k in range(1, 6))
_LENGTH = STRIP + 2 * REACH

_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_HALF = np.float32(0.5)
_C1 = np.float32(C1)
_C2 = np.float32(C2)
_ZERO = np.float32(0.0)


@inlined
def _aligned(size: Any) -> Any:
    """Zeros that start on a cache line, so that vector loads do not straddle two."""
    block = np.zeros(size + np.uint64(16), np.float32)
    shift = (np.uint64(64) - np.uint64(block.ctypes.data) % np.uint64(64)) % np.uint64(64) // np.uint64(4)
    return block[shift : shift + size]


@inlined
def _copy(row: Any, out: Any) -> None:
    for x in range(row.shape[0]):
        out[x] = row[x]


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
    fields = _aligned(np.uint64(2) * _FIELD)
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
                _copy(image[c, y, start:stop], line[shift:])
            _product(line, line, squares)
            _across(line, first, o)
            _across(squares, second, o)
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, out)
            _copy(out[:columns], mean[c, top + j, left : left + columns])
            _down(second, o, out)
            _copy(out[:columns], square[c, top + j, left : left + columns])


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
    fields = _aligned(np.uint64(3) * _FIELD)
    first, second, third = fields[:_FIELD], fields[_FIELD : 2 * _FIELD], fields[2 * _FIELD :]
    window = _aligned(np.uint64(6) * np.uint64(STRIP))
    mean, square, cross = window[:STRIP], window[STRIP : 2 * STRIP], window[2 * STRIP : 3 * STRIP]
    other, other_square, weights = (
        window[3 * STRIP : 4 * STRIP],
        window[4 * STRIP : 5 * STRIP],
        window[5 * STRIP :],
    )
    for item in range(begin, end):
        c, tile = item // (strips * bands), item % (strips * bands)
        top, left = tile // strips * BAND, tile % strips * STRIP
        columns, rows = min(STRIP, width - left), min(BAND, height - top)
        start, stop = max(0, left - REACH), min(width, left + STRIP + REACH)
        shift = start - left + REACH
        a[:] = _ZERO
        b[:] = _ZERO
        weights[:columns] = _ONE
        weights[columns:] = _ZERO
        for j in range(rows + 2 * REACH):
            y = top + j - REACH
            o = np.uint64(j) * STRIDE
            if y < 0 or y >= height:
                first[o : o + STRIDE] = _ZERO
                second[o : o + STRIDE] = _ZERO
                third[o : o + STRIDE] = _ZERO
                continue
            _copy(photo[c, y, start:stop], b[shift:])
            if masked:
                row, photo_row, weight = (
                    image[c, y, start:stop],
                    photo[c, y, start:stop],
                    valid[c, y, start:stop],
                )
                inner = a[shift : shift + stop - start]
                for x in range(inner.shape[0]):
                    inner[x] = row[x] if weight[x] > _ZERO else photo_row[x]
            else:
                _copy(image[c, y, start:stop], a[shift:])
            _product(a, a, aa)
            _product(a, b, ab)
            _across(a, first, o)
            _across(aa, second, o)
            _across(ab, third, o)
        total = 0.0
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, mean)
            _down(second, o, square)
            _down(third, o, cross)
            y = top + j
            _copy(photo_mean[c, y, left : left + columns], other)
            _copy(photo_square[c, y, left : left + columns], other_square)
            if masked:
                _copy(valid[c, y, left : left + columns], weights)
            total += _similarity_row(window)
            _copy(mean[:columns], slopes[0, c, y, left : left + columns])
            _copy(square[:columns], slopes[1, c, y, left : left + columns])
            _copy(cross[:columns], slopes[2, c, y, left : left + columns])
        sums[item, 0] = total


@inlined
def _similarity_row(rows: Any) -> Any:
    """Sum of weight * SSIM over one row of a tile.

    rows: six rows, one after the other: means of x, x^2 and x y (overwritten by the derivatives),
    means of y and y^2, weight.
    """
    total = _ZERO
    for i in range(STRIP):
        x = np.uint64(i)
        m, n, weight = rows[x], rows[x + _ROW3], rows[x + _ROW5]
        square, cross, other_square = rows[x + _ROW1], rows[x + _ROW2], rows[x + _ROW4]
        variance = square - m * m
        variance = variance if variance > _ZERO else _ZERO
        other_variance = other_square - n * n
        other_variance = other_variance if other_variance > _ZERO else _ZERO
        # Rounding must not push the correlation of flat windows above 1.
        highest, covariance = _HALF * (variance + other_variance), cross - m * n
        covariance = covariance if covariance < highest else highest
        top_mean, top_variance = _TWO * m * n + _C1, _TWO * covariance + _C2
        below_mean, below_variance = m * m + n * n + _C1, variance + other_variance + _C2
        inverse = _ONE / (below_mean * below_variance)
        value = top_mean * top_variance * inverse * weight
        inverse *= weight
        by_mean, by_variance = value / below_mean, value / below_variance
        rows[x] = _TWO * (n * (top_variance - top_mean) * inverse - m * by_mean + m * by_variance)
        rows[x + _ROW1] = -by_variance
        rows[x + _ROW2] = _TWO * top_mean * inverse
        total += value
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
    fields = _aligned(np.uint64(3) * _FIELD)
    first, second, third = fields[:_FIELD], fields[_FIELD : 2 * _FIELD], fields[2 * _FIELD :]
    lines = _aligned(np.uint64(3) * np.uint64(STRIP))
    by_mean, by_square, by_cross = lines[:STRIP], lines[STRIP : 2 * STRIP], lines[2 * STRIP :]
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
            _copy(slopes[0, c, y, start:stop], line[shift:])
            _across(line, first, o)
            _copy(slopes[1, c, y, start:stop], line[shift:])
            _across(line, second, o)
            _copy(slopes[2, c, y, start:stop], line[shift:])
            _across(line, third, o)
        total = 0.0
        for j in range(rows):
            o = np.uint64(j) * STRIDE
            _down(first, o, by_mean)
            _down(second, o, by_square)
            _down(third, o, by_cross)
            total += _gradient_row(
                by_mean, by_square, by_cross,
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
