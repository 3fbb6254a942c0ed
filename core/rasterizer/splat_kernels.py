"""One splat over the rows of one tile, forward and backward, 16 pixels at once (`lanes_kernels`).

From row to row of a Gaussian alpha changes by a ratio, and the ratio by a factor that is the same
everywhere: alpha' = alpha r, r' = r + r (exp(-c) - 1). Two operations instead of an exponential; over a
tile's rows their rounding adds up to some 1e-6. Where an exponential on the way would leave float32's range
(needles across the rows), both are computed anew in every row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import inlined
from ..constants import ALPHA_MAXIMUM, TILE, TILE_ROWS, TRANSMITTANCE_STOP
from ..lanes_kernels import Buffer, Lanes, Running, choose, maximum, minimum, power_of_two, ramp, sums_of
from .ray_kernels import HIGH, K_M, LOW, RAY_WIDTH

f32 = np.float32
PIXELS = TILE * TILE_ROWS
_LOG2E = 1.4426950408889634

# Layout of a projected Gaussian (one cache line of 16 float32): centre, opacity, colour and depth, and its
# ellipse. SHEAR, SQUEEZE, REACH, TIP describe it row by row (see `rows_in_tile`); RATIO turns them into the same
# column by column, where TURN takes the place of TIP (see `tile_columns`). CONIC is that of dy^2,
# FALL = exp(-CONIC) - 1.
(X, Y, CONIC, FALL, SHEAR, SQUEEZE, REACH, TIP, OPACITY, RED, GREEN, BLUE, DEPTH, RATIO, TURN, HALF_HEIGHT) = range(16)
SPLAT_WIDTH = 16
# Layout of a gradient slot, one per (Gaussian, tile) pair: sums of s dx, s dy, s dx^2, s dx dy, s dy^2 and s, where
# s = alpha dL/dalpha and (dx, dy) reaches from the Gaussian's centre to the pixel, and dL/dcolour.
M_X, M_Y, M_XX, M_XY, M_YY, M_ALL, M_RED, M_GREEN, M_BLUE = range(9)
SLOT_WIDTH = 9
# Layout of a pair: its Gaussian, and its row in the gradient slots.
GAUSSIAN, SLOT = 0, 1
# Planes of a tile's state. Forward: T and the colours. Backward: T, what still comes (weighted by
# the image gradient), and the image gradient.
#: (Not a power of two apart: a load would wait for a store whose address ends in the same bits.)
PLANE = PIXELS + 128
T_, R_, G_, B_ = 0, PLANE, 2 * PLANE, 3 * PLANE
REST_, DR_, DG_, DB_ = PLANE, 2 * PLANE, 3 * PLANE, 4 * PLANE
S_, E_, Q_ = PLANE, 2 * PLANE, 3 * PLANE

#: After so many rows alpha and its ratio are computed anew: never within a tile.
STRIDE = TILE_ROWS
#: Powers of two: how far an exponential may fall on the way (float32 ends at -126), what is left of a pixel that
#: counts in no row, and the least alpha_minimum and the steepest Gaussian for which that holds.
_FALL, _GONE, _LEAST_ALPHA, _STEEPEST = 80.0, -30.0, 1e-4, 3.0


@inlined
def rows_in_tile(splats, g, left, top, rows, alpha_minimum):  # type: ignore[no-untyped-def]
    """First and one past the last row that the ellipse meets in the tile whose first pixel centre is
    (left, top), and for how many rows alpha may go on by its ratio.

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
        return np.int64(0), np.int64(0), np.int64(1)
    down = splats[g, Y] - top
    first = np.ceil(max(shear * high - np.sqrt(above) + down, f32(0.0)))
    last = np.floor(min(shear * low + np.sqrt(below) + down, f32(TILE_ROWS))) + f32(1.0)
    # the largest |dy - shear dx| of any lane in these rows
    one, other = shear * near, shear * far
    away = max(last - f32(1.0) - down - min(one, other), max(one, other) - first + down)
    steep = f32(0.5 * _LOG2E) * splats[g, CONIC]
    gentle = away * away * steep <= f32(_FALL) and steep <= f32(_STEEPEST) and alpha_minimum >= f32(_LEAST_ALPHA)
    return np.int64(first), min(np.int64(last), rows), np.int64(STRIDE) if gentle else np.int64(1)


class _Splat:
    """One projected Gaussian as seen from a tile's top left pixel centre."""

    def __init__(self, builder: ir.IRBuilder, splats: Buffer, g: ir.Value, left: Lanes, top: Lanes) -> None:
        self.builder = builder
        at = builder.mul(g, ir.Constant(g.type, SPLAT_WIDTH))
        read = lambda column: splats.one(at, column)  # noqa: E731
        self.opacity, self.red, self.green, self.blue = read(OPACITY), read(RED), read(GREEN), read(BLUE)
        self.depth = read(DEPTH)
        self.top = top - read(Y)
        self.dx = left - read(X) + ramp(builder)
        # a dx^2 + 2 b dx dy + c dy^2 = c ((dy - shear dx)^2 + squeeze dx^2): nothing cancels in a long needle
        self.steep = (-0.5 * _LOG2E) * read(CONIC)
        self.base = self.steep * read(SQUEEZE) * self.dx * self.dx
        self.leaning = read(SHEAR) * self.dx
        self.fall = read(FALL).wide()

    def dy(self, row: ir.Value) -> Lanes:
        """From the centre down to a row of the tile."""
        return self.top + Lanes(self.builder, self.builder.sitofp(row, ir.FloatType()))

    def rows(self, first: ir.Value, last: ir.Value, stride: ir.Value) -> Any:
        """Loops over rows first..last of the tile; yields (row's offset in the state, alpha before its limits)."""
        builder, running = self.builder, Running(self.builder, 2)
        one = ir.Constant(first.type, 1)
        single = builder.icmp_signed("==", stride, one)
        floor = Lanes(builder, builder.select(single, *(ir.Constant(ir.FloatType(), x) for x in (-1e30, _GONE))))
        base = maximum(self.base, floor)
        with cgutils.for_range_slice(builder, first, last, stride, inc=True) as (start, _):
            u = self.dy(start) - self.leaning
            running[0] = self.opacity * power_of_two(base + self.steep * (u * u))
            running[1] = power_of_two(self.steep * (u + u + 1.0))
            end = builder.add(start, stride)
            end = builder.select(builder.icmp_signed("<", end, last), end, last)
            with cgutils.for_range_slice(builder, start, end, one, inc=True) as (row, _):
                raw, ratio = running[0], running[1]
                yield builder.mul(row, ir.Constant(row.type, TILE)), raw
                running[0], running[1] = raw * ratio, ratio.fused(self.fall, ratio)


def _limited(raw: Lanes, transmittance: Lanes, alpha_minimum: Lanes) -> Lanes:
    """Alpha after the limits: capped, zero below the minimum and where the pixel is full."""
    builder = raw.builder
    counts = builder.and_(raw.compare(">=", alpha_minimum), transmittance.compare(">=", TRANSMITTANCE_STOP))
    return choose(counts, minimum(raw, ALPHA_MAXIMUM), 0.0)


@intrinsic
def blend_splat(typing_context, state, splats, g, left, top, first, last, stride, alpha_minimum):  # type: ignore[no-untyped-def]
    """Blends Gaussian `g` over rows `first` to `last` of a tile."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        table = Buffer(context, builder, signature.args[1], arguments[1])
        splat = _Splat(builder, table, arguments[2], Lanes(builder, arguments[3]), Lanes(builder, arguments[4]))
        for row, raw in splat.rows(*arguments[5:8]):
            transmittance = tile.row(row, T_)
            weight = _limited(raw, transmittance, Lanes(builder, arguments[8])) * transmittance
            for plane, colour in ((R_, splat.red), (G_, splat.green), (B_, splat.blue)):
                tile.put_row(row, plane, tile.row(row, plane) + weight * colour)
            tile.put_row(row, T_, transmittance - weight)
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, i, f, f, i, i, i, f), generate


@intrinsic
def hold_back(typing_context, state, splats, g, left, top, first, last, stride, alpha_minimum, level):  # type: ignore[no-untyped-def]
    """Takes the light that Gaussian `g` holds back in rows `first` to `last` of a tile from what passes (plane `T_`).

    Where that falls through `level`, the Gaussian's depth is written (plane `S_`).
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        table = Buffer(context, builder, signature.args[1], arguments[1])
        splat = _Splat(builder, table, arguments[2], Lanes(builder, arguments[3]), Lanes(builder, arguments[4]))
        level = Lanes(builder, arguments[9])
        for row, raw in splat.rows(*arguments[5:8]):
            before = tile.row(row, T_)
            after = before - _limited(raw, before, Lanes(builder, arguments[8])) * before
            falls = builder.and_(before.compare(">", level), after.compare("<=", level))
            tile.put_row(row, S_, choose(falls, splat.depth.wide(), tile.row(row, S_)))
            tile.put_row(row, T_, after)
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, i, f, f, i, i, i, f, f), generate


@intrinsic
def blend_depth(typing_context, state, splats, rays, lens, g, left, top, first, last, stride, alpha_minimum, level):  # type: ignore[no-untyped-def]
    """Takes the light that Gaussian `g` holds back from what passes (plane `T_`), as `hold_back`, and adds its depth.

    That is where it is densest along each px's own ray, see `place_rays`. Weighted by the light it is added to plane
    `E_`, its square to `Q_`, and where the light falls through `level`, it is written to `S_`.

    Args:
        lens: [4] float32, fx, fy, cx, cy.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile, table, places, lens = (Buffer(context, builder, signature.args[n], arguments[n]) for n in range(4))
        left, top = Lanes(builder, arguments[5]), Lanes(builder, arguments[6])
        splat = _Splat(builder, table, arguments[4], left, top)
        at = builder.mul(arguments[4], ir.Constant(arguments[4].type, RAY_WIDTH))
        k = [places.one(at, n) for n in range(HIGH + 1)]
        fx, fy, cx, cy = (lens.one(ir.Constant(at.type, n)) for n in range(4))
        ray_x, level = (left - cx + ramp(builder)) / fx, Lanes(builder, arguments[11])
        across = [k[n] * ray_x + k[n + 2] for n in (0, 3, 6)]
        for row, raw in splat.rows(*arguments[7:10]):
            down = Lanes(builder, builder.sitofp(row, ir.FloatType())) * (1.0 / TILE)
            ray_y = (top + down - cy) / fy
            a, b, c = (side + k[n] * ray_y for side, n in zip(across, (1, 4, 7), strict=True))
            depth = (a * k[K_M] + b * k[K_M + 1] + c * k[K_M + 2]) / (a * a + b * b + c * c)
            depth = minimum(maximum(depth, k[LOW]), k[HIGH])
            before = tile.row(row, T_)
            weight = _limited(raw, before, Lanes(builder, arguments[10])) * before
            after = before - weight
            tile.put_row(row, E_, tile.row(row, E_) + weight * depth)
            tile.put_row(row, Q_, tile.row(row, Q_) + weight * depth * depth)
            falls = builder.and_(before.compare(">", level), after.compare("<=", level))
            tile.put_row(row, S_, choose(falls, depth, tile.row(row, S_)))
            tile.put_row(row, T_, after)
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, rays, lens, i, f, f, i, i, i, f, f), generate


@intrinsic
def backward_splat(typing_context, state, splats, g, left, top, first, last, stride, alpha_minimum, slots, slot, more):  # type: ignore[no-untyped-def]
    """Takes Gaussian `g` out of a tile's running sums and writes its gradients into `slots[slot]`.

    Args:
        more: float32; above 0 they are added to what is there.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        tile = Buffer(context, builder, signature.args[0], arguments[0])
        table = Buffer(context, builder, signature.args[1], arguments[1])
        splat = _Splat(builder, table, arguments[2], Lanes(builder, arguments[3]), Lanes(builder, arguments[4]))
        sums = Running(builder, 6)
        for row, raw in splat.rows(*arguments[5:8]):
            transmittance = tile.row(row, T_)
            alpha = _limited(raw, transmittance, Lanes(builder, arguments[8]))
            weight = alpha * transmittance
            dr, dg, db = tile.row(row, DR_), tile.row(row, DG_), tile.row(row, DB_)
            colour = dr * splat.red + dg * splat.green + db * splat.blue
            rest = tile.row(row, REST_) - weight * colour
            derivative = alpha * (transmittance * colour - rest.over(1.0 - alpha))
            derivative = choose(raw.compare("<", ALPHA_MAXIMUM), derivative, 0.0)
            tile.put_row(row, REST_, rest)
            tile.put_row(row, T_, transmittance - weight)
            # sums of sums: the row m before the end counts m times in the second, m (m + 1) / 2 times in the third
            sums.add(0, derivative)
            sums.add(1, sums[0])
            sums.add(2, sums[1])
            sums.add(3, weight * dr)
            sums.add(4, weight * dg)
            sums.add(5, weight * db)
        s, end, dx = sums[0], splat.dy(arguments[6]), splat.dx
        s_x, s_y = s * dx, end * s - sums[1]
        s_yy = end * (s_y - sums[1]) + 2.0 * sums[2] - sums[1]
        out = Buffer(context, builder, signature.args[9], arguments[9])
        to = builder.mul(arguments[10], ir.Constant(arguments[10].type, SLOT_WIDTH))
        moments = sums_of([s_x, s_y, s_x * dx, s_y * dx, s_yy, s, sums[3], sums[4], sums[5]])
        adds = Lanes(builder, arguments[11]).compare(">", 0.0)
        out.put_first(to, choose(adds, out.row(to) + moments, moments), SLOT_WIDTH)
        return context.get_dummy_value()

    f, i = types.float32, types.int64
    return types.void(state, splats, i, f, f, i, i, i, f, slots, i, f), generate


@intrinsic
def prefetch(typing_context, array, element):  # type: ignore[no-untyped-def]
    """Asks for the cache line of an element, counted from the beginning of the array, that will be needed soon."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        Buffer(context, builder, signature.args[0], arguments[0]).prefetch(arguments[1])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate
