"""Blending tiles of 16 x 32 pixels, forward and backward.

A tile's state (transmittance, colours, ...) lies in one float32 buffer, planes of 512 values behind
each other. A Gaussian touches only the rows that its ellipse reaches; in a row all 16 pixels are
evaluated at once (`lanes_kernels`). The backward pass runs front to back as well: it knows the
final colour, so what lies behind a Gaussian is the rest of a running sum, and nothing is ever
divided by transmittance.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from ..compiled import inlined, kernel
from ..constants import TILE, TILE_ROWS, TRANSMITTANCE_STOP
from ..lanes_kernels import Buffer, maximum
from .splat_kernels import (
    DB_,
    DG_,
    DR_,
    PIXELS,
    REST_,
    T_,
    backward_splat,
    blend_splat,
    prefetch_splat,
    rows_in_tile,
)

f32 = np.float32

#: How many Gaussians are looked at together: their rows are known, and their successors' memory asked for, before
#: the first of them is blended, and after the last one the tile may turn out to be opaque.
_LOOK = 8


@inlined
def look_ahead(splats, pair_gaussians, position, stop, last, left, top, rows, alpha_minimum, ahead):  # type: ignore[no-untyped-def]
    """Rows and stride of pairs `position` to `stop` of a tile, into `ahead` [_LOOK, 3]."""
    for i in range(stop, min(stop + _LOOK, last)):
        prefetch_splat(splats, np.int64(pair_gaussians[i]))
    for i in range(position, stop):
        ahead[i - position] = rows_in_tile(splats, np.int64(pair_gaussians[i]), left, top, rows, alpha_minimum)


@intrinsic
def is_opaque(typing_context, state):  # type: ignore[no-untyped-def]
    """Whether no pixel of the tile takes any more."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        clearest = tile.row(ir.Constant(ir.IntType(64), 0), T_)
        for row in range(1, TILE_ROWS):
            clearest = maximum(clearest, tile.row(ir.Constant(ir.IntType(64), 0), T_ + row * TILE))
        return clearest.maximum().compare("<", TRANSMITTANCE_STOP)

    return types.boolean(state), generate


@kernel
def blend_tiles(begin, end, splats, tile_starts, pair_gaussians, background, alpha_minimum, tiles_x,
                image, transmittance, blended, evaluations):  # type: ignore[no-untyped-def]  # fmt: skip
    """Blends tiles `begin` to `end`.

    Args:
        splats: [N, 16] projected Gaussians.
        tile_starts: [tiles + 1] where each tile's list begins in `pair_gaussians`.
        pair_gaussians: [P] int32 Gaussians of each tile, front to back.
        background: [3].
        image: [3, H, W] output.
        transmittance: [H, W] output.
        blended: [tiles] int32 output, how many of its list the tile took before it was opaque.
        evaluations: [tiles] int64 output, Gaussian-pixel pairs evaluated.
    """
    height, width = transmittance.shape
    state = np.empty(4 * PIXELS, np.float32)
    ahead = np.empty((_LOOK, 3), np.int64)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        state[:PIXELS] = f32(1.0)
        state[PIXELS:] = f32(0.0)
        first, last = tile_starts[tile], tile_starts[tile + 1]
        position, rows = first, 0
        while position < last:
            group, stop = position, min(position + _LOOK, last)
            look_ahead(splats, pair_gaussians, position, stop, last, x0, y0, height_here, alpha_minimum, ahead)
            while position < stop:
                g = np.int64(pair_gaussians[position])
                begin_row, end_row, stride = ahead[position - group]
                position += 1
                if begin_row < end_row:
                    blend_splat(state, splats, g, x0, y0, begin_row, end_row, stride, alpha_minimum)
                    rows += end_row - begin_row
            if is_opaque(state):
                break
        blended[tile] = position - first
        evaluations[tile] = rows * TILE
        for row in range(min(TILE_ROWS, height - top)):
            for i in range(min(TILE, width - left)):
                o = row * TILE + i
                t = state[o]
                transmittance[top + row, left + i] = t
                for channel in range(3):
                    image[channel, top + row, left + i] = state[(channel + 1) * PIXELS + o] + t * background[channel]


@kernel
def backward_tiles(begin, end, splats, tile_starts, pair_gaussians, pair_slots, alpha_minimum, tiles_x,
                   image, transmittance, blended, image_gradient, alpha_gradient, slots):  # type: ignore[no-untyped-def]  # fmt: skip
    """Gradients of tiles `begin` to `end`, one slot per (Gaussian, tile) pair.

    Args:
        image, transmittance, blended: what `blend_tiles` wrote.
        image_gradient: [3, H, W]; alpha_gradient: [H, W].
        pair_slots: [P] int32 row of `slots` that each pair writes.
        slots: [P, 9] output; pairs that were not blended are set to zero.
    """
    height, width = transmittance.shape
    state = np.empty(5 * PIXELS, np.float32)
    ahead = np.empty((_LOOK, 3), np.int64)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        first, last = tile_starts[tile], tile_starts[tile + 1]
        if first == last:
            continue
        state[:PIXELS] = f32(1.0)
        state[PIXELS:] = f32(0.0)
        for row in range(min(TILE_ROWS, height - top)):
            for i in range(min(TILE, width - left)):
                o = row * TILE + i
                y, x = top + row, left + i
                r, g, b = image_gradient[0, y, x], image_gradient[1, y, x], image_gradient[2, y, x]
                # image = colours + T background and alpha = 1 - T: both are part of what still comes
                state[REST_ + o] = (r * image[0, y, x] + g * image[1, y, x] + b * image[2, y, x]
                                    - alpha_gradient[y, x] * transmittance[y, x])  # fmt: skip
                state[DR_ + o] = r
                state[DG_ + o] = g
                state[DB_ + o] = b
        end_of_blending = first + blended[tile]
        for group in range(first, end_of_blending, _LOOK):
            stop = min(group + _LOOK, end_of_blending)
            look_ahead(splats, pair_gaussians, group, stop, end_of_blending, x0, y0, height_here, alpha_minimum, ahead)
            for position in range(group, stop):
                begin_row, end_row, stride = ahead[position - group]
                backward_splat(state, splats, np.int64(pair_gaussians[position]), x0, y0, begin_row, end_row, stride,
                               alpha_minimum, slots, np.int64(pair_slots[position]))  # fmt: skip
        for position in range(end_of_blending, last):
            slots[pair_slots[position], :] = f32(0.0)
