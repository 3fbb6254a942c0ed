"""Blending tiles of 16 x 64 pixels, forward and backward.

A tile's state (transmittance, colours, ...) lies in one float32 buffer, planes behind each other. A
Gaussian touches only the rows that its ellipse reaches; in a row all 16 pixels are blended at once
(`splat_kernels`). The backward pass runs front to back as well: it has the
final colour, so what lies behind a Gaussian is the rest of a running sum, and nothing is ever
divided by transmittance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import inlined, kernel
from ..constants import TILE, TILE_ROWS, TRANSMITTANCE_STOP
from ..lanes_kernels import Buffer, Lanes
from .splat_kernels import (
    B_,
    DB_,
    DG_,
    DR_,
    G_,
    GAUSSIAN,
    PIXELS,
    PLANE,
    R_,
    REST_,
    SLOT,
    SLOT_WIDTH,
    SPLAT_WIDTH,
    T_,
    backward_splat,
    blend_splat,
    prefetch,
    rows_in_tile,
)

f32 = np.float32

#: How many Gaussians are looked at together: their rows are known, and their successors' memory asked for, before
#: the first of them is blended, and after the last one the tile may turn out to be opaque.
_LOOK = 8


@inlined
def look_ahead(splats, pairs, position, stop, last, left, top, rows, alpha_minimum, pair_rows):  # type: ignore[no-untyped-def]
    """Rows of pairs `position` to `stop` of a tile: first, one past the last, and the stride, a byte each."""
    for i in range(stop, min(stop + _LOOK, last)):
        prefetch(splats, np.int64(pairs[i, GAUSSIAN]) * SPLAT_WIDTH)
    for i in range(position, stop):
        first, end, stride = rows_in_tile(splats, np.int64(pairs[i, GAUSSIAN]), left, top, rows, alpha_minimum)
        if first < end:
            pair_rows[i] = np.int32(first | end << 8 | stride << 16)
        else:  # beside the tile, where a frame along a path does not meet all that its neighbours do
            pair_rows[i] = np.int32(1 << 16)


@inlined
def unpacked(rows):  # type: ignore[no-untyped-def]
    """First row, one past the last, and stride, as `look_ahead` packed them."""
    rows = np.int64(rows)
    return rows & 255, (rows >> 8) & 255, rows >> 16


@inlined
def on_cache_lines(size):  # type: ignore[no-untyped-def]
    """`size` float32 that begin at a cache line: a vector across two of them takes twice as long."""
    room = np.empty(size + TILE, np.float32)
    skip = (-np.int64(room.ctypes.data) % 64) // 4
    return room[skip : skip + size]


@intrinsic
def passes_less(typing_context, state, limit):  # type: ignore[no-untyped-def]
    """Whether less than `limit` of the light passes every pixel of the tile."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        index, one = cgutils.alloca_once(builder, ir.IntType(64)), ir.Constant(ir.IntType(64), 1)
        builder.store(ir.Constant(ir.IntType(64), 0), index)
        look, done = builder.append_basic_block("look"), builder.append_basic_block("done")
        builder.branch(look)
        builder.position_at_end(look)  # the first row that is clear anywhere ends it: nearly always the first of all
        row = builder.load(index)
        after = builder.add(row, one)
        builder.store(after, index)
        clearest = tile.row(builder.mul(row, ir.Constant(row.type, TILE)), T_).maximum()
        full = clearest.compare("<", Lanes(builder, arguments[1]))
        more = builder.icmp_signed("<", after, ir.Constant(after.type, TILE_ROWS))
        builder.cbranch(builder.and_(full, more), look, done)
        builder.position_at_end(done)
        return full

    return types.boolean(state, types.float32), generate


def _rows(builder: ir.IRBuilder, at: ir.Value, stride: ir.Value, count: ir.Value) -> Any:
    """Loops over a tile's rows; yields (offset in the state, first element in an image)."""
    zero, one = (ir.Constant(count.type, n) for n in (0, 1))
    with cgutils.for_range_slice(builder, zero, count, one, inc=True) as (row, _):
        yield builder.mul(row, ir.Constant(row.type, TILE)), builder.add(at, builder.mul(row, stride))


@intrinsic
def read_tile(typing_context, state, image, transmittance, image_gradient, alpha_gradient, at, stride, rows, plane):  # type: ignore[no-untyped-def]
    """The state that the backward pass of a whole tile begins with (but T).

    image = colours + T background and alpha = 1 - T: both are part of what still comes.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile, image, transmittance, gradient, alpha_gradient = (
            Buffer(context, builder, signature.args[n], arguments[n]) for n in range(5)
        )
        for offset, pixel in _rows(builder, *arguments[5:8]):
            rest = -1.0 * alpha_gradient.row(pixel) * transmittance.row(pixel)
            for plane in (DR_, DG_, DB_):
                derivative = gradient.row(pixel)
                tile.put_row(offset, plane, derivative)
                rest = rest + derivative * image.row(pixel)
                pixel = builder.add(pixel, arguments[8])
            tile.put_row(offset, REST_, rest)
        return context.get_dummy_value()

    i = types.int64
    return types.void(state, image, transmittance, image_gradient, alpha_gradient, i, i, i, i), generate


@intrinsic
def write_tile(typing_context, state, red, green, blue, image, transmittance, at, stride, rows, plane):  # type: ignore[no-untyped-def]
    """A whole tile's pixels, over the background `red`, `green`, `blue`."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile, image, transmittance = (Buffer(context, builder, signature.args[n], arguments[n]) for n in (0, 4, 5))
        background = [Lanes(builder, arguments[n]) for n in (1, 2, 3)]
        for offset, pixel in _rows(builder, *arguments[6:9]):
            t = tile.row(offset, T_)
            transmittance.put_row(pixel, 0, t)
            for plane, behind in zip((R_, G_, B_), background, strict=True):
                image.put_row(pixel, 0, tile.row(offset, plane) + t * behind)
                pixel = builder.add(pixel, arguments[9])
        return context.get_dummy_value()

    i, f = types.int64, types.float32
    return types.void(state, f, f, f, image, transmittance, i, i, i, i), generate


@kernel
def blend_tiles(
    begin,
    end,
    splats,
    tile_starts,
    pairs,
    background,
    alpha_minimum,
    tiles_x,
    image,
    transmittance,
    blended,
    evaluations,
    pair_rows,
):  # type: ignore[no-untyped-def]
    """Blends tiles `begin` to `end`.

    Args:
        splats: [N, 16] projected Gaussians.
        tile_starts: [tiles + 1] where each tile's list begins in `pairs`.
        pairs: [P, 2] int32 Gaussian and gradient slot, each tile's front to back.
        background: [3].
        image: [3, H, W] output.
        transmittance: [H, W] output.
        blended: [tiles] int32 output, how many of its list the tile took before it was opaque.
        evaluations: [tiles] int64 output, Gaussian-pixel pairs evaluated.
        pair_rows: [P] int32 output, see `look_ahead`.
    """
    height, width = transmittance.shape
    state = on_cache_lines(4 * PLANE)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        state[:PIXELS] = f32(1.0)
        state[PIXELS:] = f32(0.0)
        first, last = tile_starts[tile], tile_starts[tile + 1]
        position, rows = first, 0
        while position < last:
            stop = min(position + _LOOK, last)
            look_ahead(splats, pairs, position, stop, last, x0, y0, height_here, alpha_minimum, pair_rows)
            while position < stop:
                g = np.int64(pairs[position, GAUSSIAN])
                begin_row, end_row, stride = unpacked(pair_rows[position])
                position += 1
                if begin_row < end_row:
                    blend_splat(state, splats, g, x0, y0, begin_row, end_row, stride, alpha_minimum)
                    rows += end_row - begin_row
            if passes_less(state, f32(TRANSMITTANCE_STOP)):
                break
        blended[tile] = position - first
        evaluations[tile] = rows * TILE
        if left + TILE <= width:
            write_tile(
                state,
                background[0],
                background[1],
                background[2],
                image,
                transmittance,
                top * width + left,
                width,
                height_here,
                height * width,
            )
        for row in range(height_here if left + TILE > width else 0):
            for i in range(min(TILE, width - left)):
                o = row * TILE + i
                t = state[o]
                transmittance[top + row, left + i] = t
                for channel in range(3):
                    image[channel, top + row, left + i] = state[(channel + 1) * PLANE + o] + t * background[channel]


@kernel
def backward_tiles(
    begin,
    end,
    splats,
    tile_starts,
    pairs,
    alpha_minimum,
    tiles_x,
    image,
    transmittance,
    blended,
    pair_rows,
    image_gradient,
    alpha_gradient,
    slots,
    more,
):  # type: ignore[no-untyped-def]
    """Gradients of tiles `begin` to `end`, one slot per (Gaussian, tile) pair.

    Args:
        image, transmittance, blended, pair_rows: what `blend_tiles` wrote.
        image_gradient: [3, H, W]; alpha_gradient: [H, W].
        slots: [P, 9] output; pairs that were not blended are set to zero.
        more: float32; above 0 gradients are added to what `slots` hold.
    """
    height, width = transmittance.shape
    state = on_cache_lines(5 * PLANE)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        first, last = tile_starts[tile], tile_starts[tile + 1]
        if first == last:
            continue
        state[:PIXELS] = f32(1.0)
        state[PIXELS:] = f32(0.0)
        if left + TILE <= width:
            read_tile(
                state,
                image,
                transmittance,
                image_gradient,
                alpha_gradient,
                top * width + left,
                width,
                height_here,
                height * width,
            )
        for row in range(height_here if left + TILE > width else 0):
            for i in range(width - left):
                o = row * TILE + i
                y, x = top + row, left + i
                r, g, b = image_gradient[0, y, x], image_gradient[1, y, x], image_gradient[2, y, x]
                state[REST_ + o] = (
                    r * image[0, y, x]
                    + g * image[1, y, x]
                    + b * image[2, y, x]
                    - alpha_gradient[y, x] * transmittance[y, x]
                )
                state[DR_ + o], state[DG_ + o], state[DB_ + o] = r, g, b
        end_of_blending = first + blended[tile]
        for position in range(first, end_of_blending):
            ahead = min(position + _LOOK, end_of_blending - 1)
            prefetch(splats, np.int64(pairs[ahead, GAUSSIAN]) * SPLAT_WIDTH)
            prefetch(slots, np.int64(pairs[ahead, SLOT]) * SLOT_WIDTH)
            begin_row, end_row, stride = unpacked(pair_rows[position])
            backward_splat(
                state,
                splats,
                np.int64(pairs[position, GAUSSIAN]),
                x0,
                y0,
                begin_row,
                end_row,
                stride,
                alpha_minimum,
                slots,
                np.int64(pairs[position, SLOT]),
                more,
            )
        for position in range(end_of_blending if more == f32(0.0) else last, last):
            slots[pairs[position, SLOT], :] = f32(0.0)
