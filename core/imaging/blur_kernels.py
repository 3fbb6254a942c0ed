"""Compiled blurs: a symmetric separable one and a direct one, each with its adjoint.

The separable blur works on 16 rows at a time. The vertical pass computes blocks of 16 x 16 px and
turns each over, so that the horizontal pass is a vertical one too: 16 rows abreast, no vector load
crosses a cache line. Either pass holds eight sums and the rows at equal distance on both sides in
registers; a pair of taps then costs two loads for eight additions and eight multiplications.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import inlined, kernel
from ..constants import TILE
from ..lanes_kernels import Buffer, Lanes, Rows, transposed

#: Sums that are kept in registers at once.
_SUMS = 8
_INDEX = ir.IntType(64)


def _index(number: int) -> ir.Constant:
    return ir.Constant(_INDEX, number)


def _convolved(builder: ir.IRBuilder, rows: Rows, first: ir.Value, half: Buffer, radius: ir.Value) -> list[Lanes]:
    """Sums number o = sum_t half[|t|] rows[first + o + radius + t], for eight o."""
    above, below, sums = ([cgutils.alloca_once(builder, Lanes.kind()) for _ in range(_SUMS)] for _ in range(3))
    centre = builder.add(first, radius)
    read = lambda slot: Lanes(builder, builder.load(slot))  # noqa: E731
    k0 = half.one(_index(0))
    for o in range(_SUMS):
        row = rows[builder.add(centre, _index(o))]
        builder.store(row.value, above[o])
        builder.store(row.value, below[o])
        builder.store((row * k0).value, sums[o])
    last = builder.add(radius, _index(1))
    with cgutils.for_range_slice(builder, _index(1), last, _index(1), inc=True) as (t, _):
        k = half.one(t).wide()
        for o in reversed(range(1, _SUMS)):
            builder.store(read(above[o - 1]).value, above[o])
        builder.store(rows[builder.sub(centre, t)].value, above[0])
        for o in range(_SUMS - 1):
            builder.store(read(below[o + 1]).value, below[o])
        end = builder.add(builder.add(centre, t), _index(_SUMS - 1))
        builder.store(rows[end].value, below[_SUMS - 1])
        for o in range(_SUMS):
            builder.store((read(sums[o]) + k * (read(above[o]) + read(below[o]))).value, sums[o])
    return [read(slot) for slot in sums]


@intrinsic
def _down(typing_context, table, first, column, half, radius, turned, at):  # type: ignore[no-untyped-def]
    """Blurs 16 rows from number `first` of a table of addresses vertically, at 16 columns.

    table: int64 addresses of rows; the output's first row is `radius` rows behind `first`.
    turned: columns of the result go to turned[16 at], turned[16 (at + 1)], ...
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        base = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        rows = Rows(builder, base, builder.mul(arguments[2], _index(4)))
        half = Buffer(context, builder, signature.args[3], arguments[3])
        block = cgutils.alloca_once(builder, Lanes.kind(), size=TILE)
        with cgutils.for_range_slice(builder, _index(0), _index(TILE), _index(_SUMS), inc=True) as (o, _):
            sums = _convolved(builder, rows, builder.add(arguments[1], o), half, arguments[4])
            for i, lanes in enumerate(sums):
                builder.store(lanes.value, builder.gep(block, [builder.add(o, _index(i))]))
        lines = [Lanes(builder, builder.load(builder.gep(block, [_index(i)]))) for i in range(TILE)]
        out = Buffer(context, builder, signature.args[5], arguments[5])
        to = builder.mul(arguments[6], _index(TILE))
        for i, lanes in enumerate(transposed(lines)):
            out.put_row(to, i * TILE, lanes)
        return context.get_dummy_value()

    i = types.int64
    return types.void(table, i, i, half, i, turned, i), generate


@intrinsic
def _across(typing_context, turned, at, half, radius):  # type: ignore[no-untyped-def]
    """Blurs eight columns in place: turned[16 (at + o)] = sum_t half[|t|] turned[16 (at + o + radius + t)]."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        rows = Rows(builder, builder.ptrtoint(data, _INDEX))
        half = Buffer(context, builder, signature.args[2], arguments[2])
        for o, lanes in enumerate(_convolved(builder, rows, arguments[1], half, arguments[3])):
            rows[builder.add(arguments[1], _index(o))] = lanes
        return context.get_dummy_value()

    i = types.int64
    return types.void(turned, i, half, i), generate


@intrinsic
def _turn_back(typing_context, turned, at, table, column):  # type: ignore[no-untyped-def]
    """Stores 16 columns from turned[16 at] as rows, at the addresses of the table, from `column` on."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        source = Buffer(context, builder, signature.args[0], arguments[0])
        base = context.make_array(signature.args[2])(context, builder, arguments[2]).data
        rows = Rows(builder, base, builder.mul(arguments[3], _index(4)))
        at = builder.mul(arguments[1], _index(TILE))
        for i, lanes in enumerate(transposed([source.row(at, k * TILE) for k in range(TILE)])):
            rows[_index(i)] = lanes
        return context.get_dummy_value()

    i = types.int64
    return types.void(turned, i, table, i), generate


@inlined
def _aligned_floats(size):  # type: ignore[no-untyped-def]
    """Zeros that start on a cache line."""
    block = np.zeros(size + TILE, np.float32)
    shift = (64 - block.ctypes.data % 64) % 64 // 4
    return block[shift : shift + size]


@inlined
def _pass_down(table, source_columns, half, radius, turned, start):  # type: ignore[no-untyped-def]
    """The vertical pass of 16 rows; column x goes to turned[16 (start + x)]."""
    for x in range(0, source_columns - TILE, TILE):
        _down(table, 0, x, half, radius, turned, start + x)
    _down(table, 0, source_columns - TILE, half, radius, turned, start + source_columns - TILE)


@inlined
def _pass_back(turned, start, table, columns):  # type: ignore[no-untyped-def]
    for x in range(0, columns - TILE, TILE):
        _turn_back(turned, start + x, table, x)
    _turn_back(turned, start + columns - TILE, table, columns - TILE)


@inlined
def _output_rows(table, out, c, y, spare):  # type: ignore[no-untyped-def]
    """Addresses of rows y to y + 15 of out[c]; rows beyond the end go to a spare one."""
    for i in range(TILE):
        table[i] = out[c, y + i].ctypes.data if y + i < out.shape[1] else spare.ctypes.data


@kernel
def separable_apply(begin, end, source, out, half_v, half_h, margin):  # type: ignore[no-untyped-def]
    """Items are 16 rows each. source [C, H + 2m, W + 2m], out [C, H, W], float32, W >= 16.

    half_v, half_h: the middle tap and those to one side.
    """
    rows, columns = source.shape[1], source.shape[2]
    height, width = out.shape[1], out.shape[2]
    rv, rh = half_v.shape[0] - 1, half_h.shape[0] - 1
    blocks = -(-height // TILE)
    turned = _aligned_floats((columns + 2 * rh + TILE) * TILE)
    inputs, outputs = np.empty(TILE + 2 * rv, np.int64), np.empty(TILE, np.int64)
    spare = np.empty(width, np.float32)
    left = max(rh - margin, 0)  # copies of the edge that are missing
    for item in range(begin, end):
        c, y = item // blocks, item % blocks * TILE
        for i in range(TILE + 2 * rv):
            inputs[i] = source[c, min(max(y + margin - rv + i, 0), rows - 1)].ctypes.data
        _output_rows(outputs, out, c, y, spare)
        _pass_down(inputs, columns, half_v, rv, turned, left)
        for x in range(left * TILE):
            turned[x] = turned[left * TILE + x % TILE]
            turned[(left + columns) * TILE + x] = turned[(left + columns - 1) * TILE + x % TILE]
        first = max(margin - rh, 0)
        for x in range(first, first + width, _SUMS):
            _across(turned, x, half_h, rh)
        _pass_back(turned, first, outputs, width)


@kernel
def separable_adjoint(begin, end, image, out, half_v, half_h, margin):  # type: ignore[no-untyped-def]
    """Items are 16 rows of out [C, H + 2m, W + 2m] each; image [C, H, W], float32, W >= 16.

    Beyond the margin the forward blur repeats the edge, so the edge here gathers what the blur of
    the zero-extended image would send beyond it.
    """
    height, width = image.shape[1], image.shape[2]
    rows, columns = out.shape[1], out.shape[2]
    rv, rh = half_v.shape[0] - 1, half_h.shape[0] - 1
    beyond = max(0, rh - margin)
    blocks = -(-rows // TILE)
    start = rh + margin + beyond  # where the image begins: rh zeros, then what lies beyond, then the margin
    total = columns + 2 * beyond
    turned = _aligned_floats((total + 2 * rh + TILE) * TILE)
    inputs, outputs = np.empty(TILE + 2 * rv, np.int64), np.empty(TILE, np.int64)
    blank, spare = np.zeros(width, np.float32), np.empty(columns, np.float32)
    for item in range(begin, end):
        c, y = item // blocks, item % blocks * TILE
        for i in range(TILE + 2 * rv):
            row = y - margin - rv + i
            inputs[i] = image[c, row].ctypes.data if 0 <= row < height else blank.ctypes.data
        _output_rows(outputs, out, c, y, spare)
        turned[: start * TILE] = np.float32(0)
        turned[(start + width) * TILE :] = np.float32(0)
        _pass_down(inputs, width, half_v, rv, turned, start)
        if rv > margin:
            if y == 0:
                _gather(image[c], half_v, -rv, -margin - 1, turned, start, 0)
            if y + TILE >= rows:
                _gather(image[c], half_v, height + margin, height + rv - 1, turned, start, rows - 1 - y)
        for x in range(0, total, _SUMS):
            _across(turned, x, half_h, rh)
        for x in range(beyond):
            for lane in range(TILE):
                turned[beyond * TILE + lane] += turned[x * TILE + lane]
                turned[(beyond + columns - 1) * TILE + lane] += turned[(beyond + columns + x) * TILE + lane]
        _pass_back(turned, beyond, outputs, columns)


@inlined
def _gather(image, half, top, bottom, turned, start, lane):  # type: ignore[no-untyped-def]
    """Adds to one row what the vertical blur sends to rows top to bottom, beyond the frame."""
    reach = half.shape[0] - 1
    for row in range(max(0, top - reach), min(image.shape[0], bottom + reach + 1)):
        weight = np.float32(0)
        for virtual in range(max(top, row - reach), min(bottom, row + reach) + 1):
            weight += half[abs(virtual - row)]
        for x in range(image.shape[1]):
            turned[(start + x) * TILE + lane] += weight * image[row, x]


@inlined
def _add_four(out: Any, a: Any, b: Any, c: Any, d: Any, k0: Any, k1: Any, k2: Any, k3: Any) -> None:
    for x in range(out.shape[0]):
        out[x] += k0 * a[x] + k1 * b[x] + k2 * c[x] + k3 * d[x]


@kernel
def correlate_rows(begin: int, end: int, source: Any, out: Any, taps: Any, first: int, every: int) -> None:
    """`correlate` of some rows alone: out[c, r, x] = sum taps[j, i] source[c, first + every r + j, x + i]."""
    rows, width = out.shape[1], out.shape[2]
    for item in range(begin, end):
        c, y = item // rows, first + every * (item % rows)
        line = out[c, item % rows]
        line[:] = 0
        for j in range(taps.shape[0]):
            row = source[c, y + j]
            for i in range(0, taps.shape[1], 4):
                _add_four(
                    line,
                    row[i : i + width],
                    row[i + 1 : i + 1 + width],
                    row[i + 2 : i + 2 + width],
                    row[i + 3 : i + 3 + width],
                    taps[j, i],
                    taps[j, i + 1],
                    taps[j, i + 2],
                    taps[j, i + 3],
                )


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
                    row[i : i + width],
                    row[i + 1 : i + 1 + width],
                    row[i + 2 : i + 2 + width],
                    row[i + 3 : i + 3 + width],
                    taps[j, i],
                    taps[j, i + 1],
                    taps[j, i + 2],
                    taps[j, i + 3],
                )
