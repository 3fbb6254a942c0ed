"""Compiled mean absolute error and SSIM, value and gradient, in one sweep.

A band of rows of one channel is swept downwards, four rows at a time: the windows of x, y, x^2, y^2
and x y, SSIM and its derivatives (kept for the last 16 rows), and, seven rows behind, the windows of the
derivatives and the gradient. Windows are summed vertically straight from the images, then horizontally
from vectors that neighbour each other, so that nothing but derivatives leaves the first-level cache.
Photo and render count as black beyond the frame, as in 3D Gaussian splatting. Rows are passed as
addresses, since those beyond the frame are one blank row.
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ...compiled import inlined, kernel
from ...constants import TILE
from ...lanes_kernels import Buffer, Lanes, Rows, choose, constant, maximum, minimum, shuffled

#: SSIM's constants (Wang et al. 2004) for values in [0, 1].
C1 = 0.01**2
C2 = 0.03**2
#: Reach of the window to either side: 11 x 11 px with a standard deviation of 1.5 px.
REACH = 5
_weights = [math.exp(-0.5 * (t / 1.5) ** 2) for t in range(REACH + 1)]
_total = _weights[0] + 2 * sum(_weights[1:])
_TAPS = [w / _total for w in _weights]

#: Rows of a band, about: each band computes SSIM of 12 more than it has.
BAND = 136
#: Rows per step, rows that its windows reach, and rows whose derivatives are kept.
_STEP = 4
_REACHED = _STEP + 2 * REACH
_KEPT = 16
_AHEAD = 3
#: Vectors kept for every row of every windowed field: the last, this one and the next, and one spare.
_SLOTS = 4
_INDEX = ir.IntType(64)
f32 = np.float32


def _index(number: int) -> ir.Constant:
    return ir.Constant(_INDEX, number)


def _table(context, builder, signature, arguments, number: int, column):  # type: ignore[no-untyped-def]
    base = context.make_array(signature.args[number])(context, builder, arguments[number]).data
    return Rows(builder, base, builder.mul(column, _index(4)))


def _slot(builder: ir.IRBuilder, position: ir.Value, shift: int) -> ir.Value:
    moved = builder.add(position, _index(shift + _SLOTS))
    return builder.mul(builder.and_(moved, _index(_SLOTS - 1)), _index(TILE))


def _windowed(values: list[Lanes], centre: int) -> Lanes:
    # In one order for every field: of equal images, the windows must be equal to the bit.
    total = values[centre].rounded("fmul", constant(values[centre].builder, _TAPS[0]))
    for t in range(1, REACH + 1):
        total = values[centre - t].rounded("fadd", values[centre + t]).fused(_TAPS[t], total)
    return total


def _put_windows(builder: ir.IRBuilder, slots: Buffer, at: ir.Value, field: int, values: list[Lanes]) -> None:
    for row in range(_STEP):
        slots.put_row(at, (field * _STEP + row) * _SLOTS * TILE, _windowed(values, row + REACH))


def _across(slots: Buffer, row: ir.Value, at: list[ir.Value], field: int) -> Lanes:
    """The horizontal window of one row of a field, from the vector before, here and after."""
    builder, plane = slots.builder, field * _STEP * _SLOTS * TILE
    before, here, after = (slots.row(builder.add(row, offset), plane) for offset in at)
    values = [shuffled(before, here, [TILE - t + i for i in range(TILE)]) for t in range(REACH, 0, -1)]
    values.append(here)
    values += [shuffled(here, after, [t + i for i in range(TILE)]) for t in range(1, REACH + 1)]
    return _windowed(values, REACH)


@intrinsic
def _fields_down(typing_context, images, photos, column, slots, position):  # type: ignore[no-untyped-def]
    """Vertical windows of x, y, x^2, y^2 and x y for four rows at 16 columns, into slot `position`."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        x, y = (_table(context, builder, signature, arguments, n, arguments[2]) for n in (0, 1))
        out = Buffer(context, builder, signature.args[3], arguments[3])
        at = _slot(builder, arguments[4], 0)
        each = [_index(i) for i in range(_REACHED)]
        _put_windows(builder, out, at, 0, [x[i] for i in each])
        _put_windows(builder, out, at, 1, [y[i] for i in each])
        _put_windows(builder, out, at, 2, [x[i].rounded("fmul", x[i]) for i in each])
        _put_windows(builder, out, at, 3, [y[i].rounded("fmul", y[i]) for i in each])
        _put_windows(builder, out, at, 4, [x[i].rounded("fmul", y[i]) for i in each])
        return context.get_dummy_value()

    i = types.int64
    return types.void(images, photos, i, slots, i), generate


@intrinsic
def _similarity(typing_context, slots, position, weights, derivatives, column, counted, totals):  # type: ignore[no-untyped-def]
    """SSIM of four rows at 16 columns: totals[:16] += counted[row] SSIM, and its derivatives.

    weights: addresses of 4 rows, 1 where a px counts, else 0. derivatives: addresses of 3 x 4 rows, the
    derivatives of SSIM with respect to the windowed means of x, x^2 and x y.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        windows = Buffer(context, builder, signature.args[0], arguments[0])
        at = [_slot(builder, arguments[1], shift) for shift in (-1, 0, 1)]
        weight_rows, derivative_rows = (_table(context, builder, signature, arguments, n, arguments[4]) for n in (2, 3))
        share = Buffer(context, builder, signature.args[5], arguments[5])
        sums = Buffer(context, builder, signature.args[6], arguments[6])
        with cgutils.for_range_slice(builder, _index(0), _index(_STEP), _index(1), inc=True) as (row, _):
            offset = builder.mul(row, _index(_SLOTS * TILE))
            m, n, square, other_square, cross = (_across(windows, offset, at, field) for field in range(5))
            weight = weight_rows[row]
            minus = -1.0 * n
            variance = maximum((-1.0 * m).fused(m, square), 0.0)
            other_variance = maximum(minus.fused(n, other_square), 0.0)
            # Rounding must not push the correlation of flat windows beyond 1 or -1.
            highest = 0.5 * (variance + other_variance)
            covariance = maximum(minimum(minus.fused(m, cross), highest), -1.0 * highest)
            top_mean, top_variance = 2.0 * m * n + C1, 2.0 * covariance + C2
            below_mean, below_variance = m * m + n * n + C1, variance + other_variance + C2
            unit = constant(builder, 1.0) / (below_mean * below_variance)
            inverse = weight * unit
            value = top_mean * top_variance * inverse
            by_mean, by_variance = value * below_variance * unit, value * below_mean * unit
            first = 2.0 * (n * (top_variance - top_mean) * inverse + m * (by_variance - by_mean))
            for field, derivative in enumerate((first, -1.0 * by_variance, 2.0 * top_mean * inverse)):
                derivative_rows[builder.add(row, _index(field * _STEP))] = derivative
            sums.put_row(_index(0), 0, sums.row(_index(0)) + value * share.one(row))
        return context.get_dummy_value()

    i = types.int64
    return types.void(slots, i, weights, derivatives, i, counted, totals), generate


@intrinsic
def _derivatives_down(typing_context, derivatives, column, slots, position):  # type: ignore[no-untyped-def]
    """Vertical windows of the three derivatives (addresses of 3 x 14 rows), into slot `position`."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        rows = _table(context, builder, signature, arguments, 0, arguments[1])
        out = Buffer(context, builder, signature.args[2], arguments[2])
        at = _slot(builder, arguments[3], 0)
        for field in range(3):
            values = [rows[_index(field * _REACHED + i)] for i in range(_REACHED)]
            _put_windows(builder, out, at, field, values)
        return context.get_dummy_value()

    i = types.int64
    return types.void(derivatives, i, slots, i), generate


@intrinsic
def _pull(typing_context, slots, position, images, photos, weights, outs, column, by_error, by_similarity, totals):  # type: ignore[no-untyped-def]
    """The gradient of four rows at 16 columns; totals[16:32] += |x - y|. Tables hold 4 addresses each."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        windows = Buffer(context, builder, signature.args[0], arguments[0])
        at = [_slot(builder, arguments[1], shift) for shift in (-1, 0, 1)]
        image, photo, weight, out = (
            _table(context, builder, signature, arguments, n, arguments[6]) for n in (2, 3, 4, 5)
        )
        error, similarity = Lanes(builder, arguments[7]), Lanes(builder, arguments[8])
        sums = Buffer(context, builder, signature.args[9], arguments[9])
        with cgutils.for_range_slice(builder, _index(0), _index(_STEP), _index(1), inc=True) as (row, _):
            offset = builder.mul(row, _index(_SLOTS * TILE))
            by_mean, by_square, by_cross = (_across(windows, offset, at, field) for field in range(3))
            x, y = image[row], photo[row]
            by_window = by_mean + 2.0 * x * by_square + y * by_cross
            difference = x - y
            more, less = difference.compare(">", 0.0), difference.compare("<", 0.0)
            zero = constant(builder, 0.0).wide()
            sign = choose(more, error.wide(), choose(less, -1.0 * error.wide(), zero))
            out[row] = sign - similarity * by_window * weight[row]
            size = choose(more, difference, -1.0 * difference)
            sums.put_row(_index(0), TILE, sums.row(_index(0), TILE) + size)
        return context.get_dummy_value()

    i, f = types.int64, types.float32
    return types.void(slots, i, images, photos, weights, outs, i, f, f, totals), generate


@inlined
def _address(array, c, y, blank):  # type: ignore[no-untyped-def]
    """Address of a row, or of the blank one beyond the frame."""
    return array[c, y].ctypes.data if 0 <= y < array.shape[1] else blank.ctypes.data


@inlined
def _clear(slots, position):  # type: ignore[no-untyped-def]
    for row in range(5 * _STEP):
        o = (row * _SLOTS + position % _SLOTS) * TILE
        slots[o : o + TILE] = f32(0)


@inlined
def _aligned(size):  # type: ignore[no-untyped-def]
    """Zeros that start on a cache line."""
    block = np.zeros(size + TILE, np.float32)
    shift = (64 - block.ctypes.data % 64) % 64 // 4
    return block[shift : shift + size]


@kernel
def photometric(begin, end, bands, image, photo, weights, by_error, by_similarity, out, sums):  # type: ignore[no-untyped-def]
    """Items are bands of rows of one channel: sums[item] = sums of SSIM and |x - y|; out = the gradient.

    Args:
        image, photo: [C, H, W] float32, equal where a px does not count; W is a multiple of 16.
        weights: [C, H, W] float32, 1 where a px counts, else 0; or [1, 1, W] for all rows.
        by_error, by_similarity: what one px of either term weighs in the loss.
    """
    _, height, width = image.shape
    rows = -(-height // (bands * _STEP)) * _STEP
    one_row = weights.shape[0] == 1 and weights.shape[1] == 1
    kept = _aligned(3 * _KEPT * width)
    slots = _aligned(5 * _STEP * _SLOTS * TILE)
    blank, spare = np.zeros(width, np.float32), np.empty(width, np.float32)
    xs, ys = np.empty(_REACHED, np.int64), np.empty(_REACHED, np.int64)
    ws, to = np.empty(_STEP, np.int64), np.empty(_STEP, np.int64)
    written, reached = np.empty(3 * _STEP, np.int64), np.empty(3 * _REACHED, np.int64)
    counted, totals = np.empty(_STEP, np.float32), np.empty(2 * TILE, np.float32)
    for item in range(begin, end):
        c, top = item // bands, item % bands * rows
        bottom = min(top + rows, height)
        structure, error = 0.0, 0.0
        for step in range(-(-(bottom - top) // _STEP) + _AHEAD):
            first = top - REACH + step * _STEP
            totals[:] = f32(0)
            for i in range(_REACHED):
                y = first - REACH + i
                xs[i], ys[i] = _address(image, c, y, blank), _address(photo, c, y, blank)
            for i in range(_STEP):
                y = first + i
                counted[i] = f32(1) if top <= y < bottom else f32(0)
                ws[i] = weights[0, 0].ctypes.data if one_row and 0 <= y < height else _address(weights, c, y, blank)
                for field in range(3):
                    ring = field * _KEPT + (step * _STEP + i) % _KEPT
                    written[field * _STEP + i] = kept[ring * width :].ctypes.data
            _clear(slots, _SLOTS - 1)
            _fields_down(xs, ys, 0, slots, 0)
            for position in range(width // TILE):
                if (position + 1) * TILE < width:
                    _fields_down(xs, ys, (position + 1) * TILE, slots, position + 1)
                else:
                    _clear(slots, position + 1)
                _similarity(slots, position, ws, written, position * TILE, counted, totals)
            if step >= _AHEAD:
                first = top + (step - _AHEAD) * _STEP
                for i in range(_STEP):
                    y = first + i
                    xs[i], ys[i] = _address(image, c, y, blank), _address(photo, c, y, blank)
                    ws[i] = weights[0, 0].ctypes.data if one_row and y < height else _address(weights, c, y, blank)
                    to[i] = _address(out, c, y, spare) if y < bottom else spare.ctypes.data
                for i in range(_REACHED):
                    for field in range(3):
                        ring = field * _KEPT + ((step - _AHEAD) * _STEP + i) % _KEPT
                        reached[field * _REACHED + i] = kept[ring * width :].ctypes.data
                # Rows of the next band are measured there.
                for i in range(_STEP):
                    if first + i >= bottom:
                        xs[i], ys[i] = blank.ctypes.data, blank.ctypes.data
                _clear(slots, _SLOTS - 1)
                _derivatives_down(reached, 0, slots, 0)
                for position in range(width // TILE):
                    if (position + 1) * TILE < width:
                        _derivatives_down(reached, (position + 1) * TILE, slots, position + 1)
                    else:
                        _clear(slots, position + 1)
                    _pull(slots, position, xs, ys, ws, to, position * TILE, by_error, by_similarity, totals)
            for i in range(TILE):
                structure += totals[i]
                error += totals[TILE + i]
        sums[item, 0] = structure
        sums[item, 1] = error
