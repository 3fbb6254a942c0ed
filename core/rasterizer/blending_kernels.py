"""Blending tiles of 16 x 32 pixels, forward and backward.

A tile's state (transmittance, colours, ...) lies in one float32 buffer, planes of 512 values behind
each other. A Gaussian touches only the rows that its ellipse reaches; in a row all 16 pixels are
evaluated at once (`lanes_kernels`). The backward pass runs front to back as well: it knows the
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
from ..constants import ALPHA_MAXIMUM, TILE, TILE_ROWS, TRANSMITTANCE_STOP
from ..lanes_kernels import Buffer, Lanes, Running, choose, maximum, minimum, power_of_two, ramp

f32 = np.float32
_PIXELS = TILE * TILE_ROWS
_STOP = f32(TRANSMITTANCE_STOP)
_LOG2E = 1.4426950408889634

# Layout of a projected Gaussian (one cache line of 16 float32):
# centre, conic, colour, depth; SHEAR, SQUEEZE, REACH, TIP describe the same ellipse row by row (see
# `rows_in_tile`), FIRST_ROW and LAST_ROW its box.
(X, Y, CONIC_A, CONIC_B, CONIC_C, OPACITY, RED, GREEN, BLUE, DEPTH, SHEAR, SQUEEZE, REACH, TIP, FIRST_ROW,
 LAST_ROW) = range(16)  # fmt: skip
SPLAT_WIDTH = 16
# Layout of a gradient slot, one per (Gaussian, tile) pair:
G_X, G_Y, G_A, G_B, G_C, G_OPACITY, G_RED, G_GREEN, G_BLUE = range(9)
SLOT_WIDTH = 9
# Planes of a tile's state. Forward: T and the colours. Backward: T, what still comes (weighted by
# the image gradient), and the image gradient.
_T, _R, _G, _B = 0, _PIXELS, 2 * _PIXELS, 3 * _PIXELS
_REST, _DR, _DG, _DB = _PIXELS, 2 * _PIXELS, 3 * _PIXELS, 4 * _PIXELS

#: How many Gaussians are blended between two looks at whether the tile is already opaque.
_LOOK = 8


class _Splat:
    """One projected Gaussian as seen from a tile's top left pixel centre."""

    def __init__(self, builder: ir.IRBuilder, splats: Buffer, at: ir.Value, left: Lanes, top: Lanes) -> None:
        self.builder = builder
        read = lambda column: splats.one(at, column)  # noqa: E731
        self.a, self.b, self.c, self.opacity = read(CONIC_A), read(CONIC_B), read(CONIC_C), read(OPACITY)
        self.red, self.green, self.blue = read(RED), read(GREEN), read(BLUE)
        self.top = top - read(Y)
        self.dx = left - read(X) + ramp(builder)
        # a dx^2 + 2 b dx dy + c dy^2 = c ((dy - shear dx)^2 + squeeze dx^2): nothing cancels in a long needle
        self.steep = (-0.5 * _LOG2E) * self.c
        self.base = self.steep * read(SQUEEZE) * self.dx * self.dx
        self.leaning = read(SHEAR) * self.dx

    def raw_alpha(self, dy: Lanes) -> Lanes:
        """Opacity times the Gaussian's fall-off, before the limits."""
        u = dy - self.leaning
        return self.opacity * power_of_two(self.base + self.steep * (u * u))


def _limited(raw: Lanes, transmittance: Lanes, alpha_minimum: Lanes) -> Lanes:
    """Alpha after the limits: capped, zero below the minimum and where the pixel is full."""
    builder = raw.builder
    counts = builder.and_(raw.compare(">=", alpha_minimum), transmittance.compare(">=", float(_STOP)))
    return choose(counts, minimum(raw, ALPHA_MAXIMUM), 0.0)


def _each_row(builder: ir.IRBuilder, splat: _Splat, first: ir.Value, last: ir.Value) -> Any:
    """Loops over rows first..last of the tile; yields (row offset in the state, dy)."""

    def rows() -> Any:
        step = ir.Constant(first.type, 1)
        with cgutils.for_range_slice(builder, first, last, step, inc=True) as (row, _):
            dy = splat.top + Lanes(builder, builder.sitofp(row, ir.FloatType()))
            yield builder.mul(row, ir.Constant(row.type, TILE)), dy

    return rows()


@intrinsic
def blend_splat(typing_context, state, splats, g, left, top, first, last, alpha_minimum):  # type: ignore[no-untyped-def]
    """Blends Gaussian `g` over rows `first` to `last` of a tile."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        table = Buffer(context, builder, signature.args[1], arguments[1])
        at = builder.mul(arguments[2], ir.Constant(arguments[2].type, SPLAT_WIDTH))
        splat = _Splat(builder, table, at, Lanes(builder, arguments[3]), Lanes(builder, arguments[4]))
        for row, dy in _each_row(builder, splat, arguments[5], arguments[6]):
            transmittance = tile.row(row, _T)
            alpha = _limited(splat.raw_alpha(dy), transmittance, Lanes(builder, arguments[7]))
            weight = alpha * transmittance
            for plane, colour in ((_R, splat.red), (_G, splat.green), (_B, splat.blue)):
                tile.put_row(row, plane, tile.row(row, plane) + weight * colour)
            tile.put_row(row, _T, transmittance - weight)
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, i, f, f, i, i, f), generate


@intrinsic
def backward_splat(typing_context, state, splats, g, left, top, first, last, alpha_minimum, slots, slot):  # type: ignore[no-untyped-def]
    """Takes Gaussian `g` out of a tile's running sums and writes its gradients into `slots[slot]`."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        table = Buffer(context, builder, signature.args[1], arguments[1])
        at = builder.mul(arguments[2], ir.Constant(arguments[2].type, SPLAT_WIDTH))
        splat = _Splat(builder, table, at, Lanes(builder, arguments[3]), Lanes(builder, arguments[4]))
        sums = Running(builder, 6)
        for row, dy in _each_row(builder, splat, arguments[5], arguments[6]):
            transmittance = tile.row(row, _T)
            raw = splat.raw_alpha(dy)
            alpha = _limited(raw, transmittance, Lanes(builder, arguments[7]))
            weight = alpha * transmittance
            dr, dg, db = tile.row(row, _DR), tile.row(row, _DG), tile.row(row, _DB)
            colour = dr * splat.red + dg * splat.green + db * splat.blue
            rest = tile.row(row, _REST) - weight * colour
            through = 1.0 - alpha
            slope = alpha * (transmittance * colour - rest / through)
            slope = choose(raw.compare("<", ALPHA_MAXIMUM), slope, 0.0)
            tile.put_row(row, _REST, rest)
            tile.put_row(row, _T, transmittance - weight)
            sums.add(0, slope)
            sums.add(1, slope * dy)
            sums.add(2, slope * (dy * dy))
            sums.add(3, weight * dr)
            sums.add(4, weight * dg)
            sums.add(5, weight * db)
        s, s_y, s_yy = sums[0], sums[1], sums[2]
        s_x = s * splat.dx
        x, y, xy = s_x.sum(), s_y.sum(), (s_y * splat.dx).sum()
        out = Buffer(context, builder, signature.args[8], arguments[8])
        to = builder.mul(arguments[9], ir.Constant(arguments[9].type, SLOT_WIDTH))
        out.put_one(to, G_X, splat.a * x + splat.b * y)
        out.put_one(to, G_Y, splat.b * x + splat.c * y)
        out.put_one(to, G_A, -0.5 * (s_x * splat.dx).sum())
        out.put_one(to, G_B, -1.0 * xy)
        out.put_one(to, G_C, -0.5 * s_yy.sum())
        out.put_one(to, G_OPACITY, s.sum() / splat.opacity)
        for column, position in ((G_RED, 3), (G_GREEN, 4), (G_BLUE, 5)):
            out.put_one(to, column, sums[position].sum())
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, i, f, f, i, i, f, slots, i), generate


@inlined
def rows_in_tile(splats, g, left, top, rows):  # type: ignore[no-untyped-def]
    """First and one past the last row that the ellipse meets in the tile whose first pixel centre is (left, top).

    The ellipse is (dy - shear dx)^2 + squeeze dx^2 = reach; its lowest point, at dx = tip, or the edge of
    the tile nearest to it, bounds the rows below, the opposite point those above.
    """
    near = left - splats[g, X]
    far = near + f32(TILE - 1)
    low = min(max(splats[g, TIP], near), far)
    high = min(max(-splats[g, TIP], near), far)
    shear, squeeze, reach = splats[g, SHEAR], splats[g, SQUEEZE], splats[g, REACH]
    below, above = reach - squeeze * low * low, reach - squeeze * high * high
    if not (below >= f32(0.0) and above >= f32(0.0)):
        return np.int64(0), np.int64(0)
    down = splats[g, Y] - top
    first = np.ceil(max(shear * high - np.sqrt(above) + down, f32(0.0)))
    last = np.floor(min(shear * low + np.sqrt(below) + down, f32(TILE_ROWS))) + f32(1.0)
    return np.int64(first), min(np.int64(last), rows)


@intrinsic
def is_opaque(typing_context, state):  # type: ignore[no-untyped-def]
    """Whether no pixel of the tile takes any more."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        clearest = tile.row(ir.Constant(ir.IntType(64), 0), _T)
        for row in range(1, TILE_ROWS):
            clearest = maximum(clearest, tile.row(ir.Constant(ir.IntType(64), 0), _T + row * TILE))
        return clearest.maximum().compare("<", float(_STOP))

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
    state = np.empty(4 * _PIXELS, np.float32)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        state[:_PIXELS] = f32(1.0)
        state[_PIXELS:] = f32(0.0)
        first, last = tile_starts[tile], tile_starts[tile + 1]
        position, rows = first, 0
        while position < last:
            stop = min(position + _LOOK, last)
            while position < stop:
                g = np.int64(pair_gaussians[position])
                position += 1
                begin_row, end_row = rows_in_tile(splats, g, x0, y0, height_here)
                if begin_row < end_row:
                    blend_splat(state, splats, g, x0, y0, begin_row, end_row, alpha_minimum)
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
                    image[channel, top + row, left + i] = state[(channel + 1) * _PIXELS + o] + t * background[channel]


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
    state = np.empty(5 * _PIXELS, np.float32)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        height_here = min(np.int64(TILE_ROWS), np.int64(height - top))
        first, last = tile_starts[tile], tile_starts[tile + 1]
        if first == last:
            continue
        state[:_PIXELS] = f32(1.0)
        state[_PIXELS:] = f32(0.0)
        for row in range(min(TILE_ROWS, height - top)):
            for i in range(min(TILE, width - left)):
                o = row * TILE + i
                y, x = top + row, left + i
                r, g, b = image_gradient[0, y, x], image_gradient[1, y, x], image_gradient[2, y, x]
                # image = colours + T background and alpha = 1 - T: both are part of what still comes
                state[_REST + o] = (r * image[0, y, x] + g * image[1, y, x] + b * image[2, y, x]
                                    - alpha_gradient[y, x] * transmittance[y, x])  # fmt: skip
                state[_DR + o] = r
                state[_DG + o] = g
                state[_DB + o] = b
        end_of_blending = first + blended[tile]
        for position in range(first, last):
            slot = np.int64(pair_slots[position])
            if position >= end_of_blending:
                slots[slot, :] = f32(0.0)
                continue
            g = np.int64(pair_gaussians[position])
            begin_row, end_row = rows_in_tile(splats, g, x0, y0, height_here)
            backward_splat(state, splats, g, x0, y0, begin_row, end_row, alpha_minimum, slots, slot)
