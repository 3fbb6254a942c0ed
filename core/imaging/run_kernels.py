"""Compiled blur by a kernel whose rows hold long runs of equal taps, such as a disk.

Of every row of the source its px lie in memory, and behind them their sums from the left: so a run of equal taps is two
reads as well, with opposite weights, and all that is left to do is to add up weighted reads. Four vectors of 16 px stay
in registers over the whole kernel; rows that hold nothing but zeros before a block of the output are left out.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import kernel
from ..constants import TILE
from ..lanes_kernels import Buffer, Lanes, Running

#: Px of a row whose being zero is found out together, and px of a row of the output that are computed together.
CELL, BLOCK = TILE, 4 * TILE

_INDEX = ir.IntType(64)


def _index(number: int) -> ir.Constant:
    return ir.Constant(_INDEX, number)


@intrinsic
def _sum_of_reads(typing_context, table, which, count, starts, offsets, weights, to):  # type: ignore[no-untyped-def]
    """Writes 64 floats to address `to`: the sum over n < count and taps t of row which[n] of weights[t] times the 64
    floats at table[n] + offsets[t].
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        addresses, rows, begins, places, factors = (
            Buffer(context, builder, signature.args[i], arguments[i]) for i in (0, 1, 3, 4, 5)
        )
        sums = Running(builder, BLOCK // TILE)
        with cgutils.for_range_slice(builder, _index(0), arguments[2], _index(1), inc=True) as (n, _):
            row, address = rows.one(n).value, addresses.one(n).value
            first, last = begins.one(row).value, begins.one(row, 1).value
            with cgutils.for_range_slice(builder, first, last, _index(1), inc=True) as (t, _):
                weight, place = factors.one(t).wide(), builder.add(address, places.one(t).value)
                for i in range(BLOCK // TILE):
                    where = builder.inttoptr(builder.add(place, _index(4 * TILE * i)), Lanes.kind().as_pointer())
                    sums.add(i, weight * Lanes(builder, builder.load(where, align=4)))
        for i in range(BLOCK // TILE):
            where = builder.add(arguments[6], _index(4 * TILE * i))
            builder.store(sums[i].value, builder.inttoptr(where, Lanes.kind().as_pointer()), align=4)
        return context.get_dummy_value()

    i = types.int64
    return types.void(table, which, i, starts, offsets, weights, i), generate


@kernel
def lay_out(begin: int, end: int, source: Any, shift: Any, repeats: Any, out: Any, filled: Any) -> None:
    """Items are rows of all channels of out [C, h, 2 L + 1]: a row's px, and from L on their sums from the left.

    Row y of out is row y - shift[0] of source [C, H, W], and begins shift[1] px before it; beyond the source is its
    edge (repeats) or nothing. filled [C, h, cells + 1]: how many of the cells of 16 px left of each are not all zeros.
    """
    height, half = out.shape[1], out.shape[2] // 2
    rows, columns = source.shape[1], source.shape[2]
    for item in range(begin, end):
        c, y = item // height, item % height
        line, count = out[c, y], filled[c, y]
        at = y - shift[0]
        if not repeats and (at < 0 or at >= rows):
            count[:] = 0
            continue
        row = source[c, min(max(at, 0), rows - 1)]
        first, last = shift[1], min(shift[1] + columns, half)
        line[:half] = 0
        cut = max(0, -first)
        line[first + cut : last] = row[cut : last - first]
        if repeats:
            line[: max(first, 0)] = row[0]
            line[last:half] = row[columns - 1]
        total = line[0] - line[0]
        count[0] = 0
        for cell in range(count.shape[0] - 1):
            some = False
            for x in range(cell * CELL, min((cell + 1) * CELL, half)):
                line[half + x] = total
                total += line[x]
                some |= line[x] != 0
            count[cell + 1] = count[cell] + some
        line[2 * half] = total


@kernel
def add_up(
    begin: int, end: int, lines: Any, filled: Any, reach: int, taps: Any, rows: Any, wanted: Any, tables: Any, out: Any
) -> None:
    """Items are rows of all channels of out [C, R, W], W >= 64: row r is what the kernel makes of rows y to y + K - 1
    of `lines` (of `lay_out`), y = rows[0] + r rows[1].

    reach: columns of the kernel, less one; taps: starts [K + 1] of each row's taps, their offsets from a row's first
    float, bytes, and their weights.
    wanted [R, blocks]: 0 where a block of the output may stay zero; tables: [items, 2, K], workspace.
    """
    starts, offsets, weights = taps
    height, width, count = out.shape[1], out.shape[2], starts.shape[0] - 1
    for item in range(begin, end):
        c, r = item // height, item % height
        y, line = rows[0] + r * rows[1], out[c, r]
        table, which = tables[item, 0], tables[item, 1]
        for block in range(wanted.shape[1]):
            left = min(block * BLOCK, width - BLOCK)
            if wanted[r, block] == 0:
                line[block * BLOCK : left + BLOCK] = 0
                continue
            first, last = left // CELL, (left + BLOCK + reach - 1) // CELL + 1
            some = 0
            for j in range(count):
                if filled[c, y + j, last] > filled[c, y + j, first]:
                    table[some] = lines[c, y + j].ctypes.data + 4 * left
                    which[some] = j
                    some += 1
            _sum_of_reads(table, which, some, starts, offsets, weights, line.ctypes.data + 4 * left)
