"""Projecting Gaussians to the screen, sixteen at once (`shape_kernels`), and the tiles that each one meets.

Items of the parallel loops are blocks of `BLOCK` Gaussians, a size that does not depend on the
number of threads: partial sums for the pose are added in the same order on every machine.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import exact, kernel
from ..constants import HARMONICS_LIMIT, TILE, TILE_ROWS
from ..lanes_kernels import Running, choose, exponential, logarithm, maximum, root, transposed
from .shape_kernels import (
    P_LOGIT,
    P_SH,
    PARAMETER_PLANES,
    V_ALPHA_MINIMUM,
    V_CX,
    V_CY,
    V_HEIGHT,
    V_WIDTH,
    Planes,
    Shape,
    View,
    gathered,
    harmonics,
)
from .splat_kernels import (
    BLUE,
    CONIC,
    DEPTH,
    FALL,
    GREEN,
    HALF_HEIGHT,
    OPACITY,
    RATIO,
    REACH,
    RED,
    SHEAR,
    SPLAT_WIDTH,
    SQUEEZE,
    TIP,
    TURN,
    X,
    Y,
)

f32 = np.float32
BLOCK = 256

#: For so many rows of tiles the columns are kept from the projection: for all of an ellipse up to 128 px high.
KEPT_SPANS = 3
# Layout of a Gaussian's record of tiles (16 bytes of int16): first row of tiles, number of rows, then first and one
# past the last column of the first `KEPT_SPANS` rows.
R_FIRST, R_ROWS, R_SPANS, RECORD_WIDTH = 0, 1, 2, 2 + 2 * KEPT_SPANS

#: Where a splat ends when no alpha is too small (`projection.SMOOTH_ALPHA_EDGE`, which needs torch).
_SMOOTH_EDGE = 1e-12

# Status of a Gaussian after projection; the index into `CULL_REASONS` where it was culled.
SEEN, NON_FINITE, BEHIND, TRANSPARENT, OUTSIDE, DEGENERATE = range(6)
CULL_REASONS = ("", "non_finite", "behind", "transparent", "outside", "degenerate")

# Planes that `_project` writes: 16 rows of splats, then these, then the harmonics.
_STATUS, _RADIUS, _BASIS = 16, 17, 18


@intrinsic
def _project(typing_context, view, parameters, count, out):  # type: ignore[no-untyped-def]
    """Projects 16 Gaussians with `count` harmonics each: planes `parameters` -> planes `out`."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        view = View(context, builder, signature.args[0], arguments[0])
        planes = Planes(context, builder, signature.args[1], arguments[1])
        out = Planes(context, builder, signature.args[3], arguments[3])
        shape = Shape(view, planes)

        basis = harmonics(*(component.single() for component in shape.look))
        for k, value in enumerate(basis):
            out[_BASIS + k] = value
        # colour, something that is 0 if every harmonic is finite, and their length
        running = Running(builder, 5)
        one, zero = (ir.Constant(ir.IntType(64), n) for n in (1, 0))
        row = lambda buffer, plane, index, step: buffer.row(  # noqa: E731
            builder.mul(index, ir.Constant(index.type, step * TILE)), plane * TILE
        )
        with cgutils.for_range_slice(builder, zero, arguments[2], one, inc=True) as (k, _):
            value = row(out.buffer, _BASIS, k, 1)
            for channel in range(3):
                coefficient = row(planes.buffer, P_SH + channel, k, 3)
                running.add(channel, value * coefficient)
                running.add(3, coefficient * 0.0)
                running.add(4, coefficient * coefficient)
        # (one by one: a sum of large numbers, then times 0, would be NaN)
        finite = running[3].compare("==", 0.0)
        for k in range(P_LOGIT + 1):
            finite = builder.and_(finite, (planes[k] * 0.0).compare("==", 0.0))

        least = view[V_ALPHA_MINIMUM]
        least = choose(least.compare(">", 0.0), least, _SMOOTH_EDGE)
        opacity = shape.opacity * root(shape.share)
        cutoff = 2.0 * logarithm(opacity / least)
        a, b, c = shape.a, shape.b, shape.c
        x = shape.point[0] * shape.focal_x + view[V_CX]
        y = shape.point[1] * shape.focal_y + view[V_CY]
        half_x, half_y = root(maximum(cutoff * a, 0.0)), root(maximum(cutoff * c, 0.0))
        beside = [
            (x + half_x).compare("<=", 0.0),
            (x - half_x).compare(">=", view[V_WIDTH]),
            (y + half_y).compare("<=", 0.0),
            (y - half_y).compare(">=", view[V_HEIGHT]),
        ]
        status = planes[0].like(SEEN).wide()
        for condition in beside:
            status = choose(condition, status.like(OUTSIDE), status)
        visible = opacity.compare(">", least)
        fits = builder.and_(shape.fits, running[4].compare("<=", HARMONICS_LIMIT**2))
        for condition, reason in (
            (visible, TRANSPARENT),
            (fits, DEGENERATE),
            (shape.in_front, BEHIND),
            (finite, NON_FINITE),
        ):
            status = choose(condition, status, status.like(reason))
        out[_STATUS] = status
        out[_RADIUS] = maximum(half_x, half_y).single()

        # a hair more, so that rounding never skips a row or a tile whose alpha still counts
        margin = cutoff * 1.0001 + 1e-4
        inverse_a, inverse_c = 1.0 / a, 1.0 / c
        slim = shape.determinant * inverse_a
        conic = a * shape.inverse_determinant
        shear = b * inverse_a
        columns = {
            X: x,
            Y: y,
            OPACITY: opacity,
            DEPTH: shape.point[2],
            CONIC: conic,
            FALL: exponential(-conic) - 1.0,
            SHEAR: shear,
            SQUEEZE: slim * inverse_a,
            REACH: margin * slim,
            RATIO: a * inverse_c,
            TIP: b * inverse_c * root(margin * c),
            TURN: shear * root(margin * a),
            HALF_HEIGHT: root(margin * c),
        }
        rows = {column: lanes.single() for column, lanes in columns.items()}
        for channel in range(3):
            rows[(RED, GREEN, BLUE)[channel]] = maximum(running[channel] + 0.5, 0.0)
        for i, splat in enumerate(transposed([rows[column] for column in range(SPLAT_WIDTH)])):
            out[i] = splat
        return context.get_dummy_value()

    return types.void(view, parameters, types.int64, out), generate


@kernel
def project(
    begin, end, view, means, log_scales, quaternions, opacity_logits, sh, splats, status, radius, tile_counts, records
):  # type: ignore[no-untyped-def]
    """Projects blocks `begin` to `end` of `BLOCK` Gaussians.

    Args:
        view: [25] float64, see `V_*`.
        splats: [N, 16] output rows for the blending kernels (only those with status SEEN hold anything).
        status: [N] uint8 output.
        radius: [N] float32 output, half-extent in px, 0 where culled.
        tile_counts: [N] int32 output, how many tiles the ellipse meets.
        records: [N, 8] int16 output, see `R_*`.
    """
    parameters = np.empty(PARAMETER_PLANES * TILE, np.float32)
    out = np.empty((_BASIS + 16) * TILE, np.float32)
    rows = out[: SPLAT_WIDTH * TILE].reshape(TILE, SPLAT_WIDTH)
    width, height = f32(view[V_WIDTH]), f32(view[V_HEIGHT])
    stop = min(end * BLOCK, means.shape[0])
    for first in range(begin * BLOCK, stop, TILE):
        last = min(first + TILE, stop)
        gathered(means, log_scales, quaternions, opacity_logits, sh, first, last, parameters)
        _project(view, parameters, sh.shape[1], out)
        splats[first:last] = rows[: last - first]
        for g in range(first, last):
            status[g] = np.uint8(out[_STATUS * TILE + g - first])
            radius[g] = f32(0.0)
            tile_counts[g] = 0
            if status[g] != SEEN:
                continue
            begin_row, end_row = tile_rows(splats, g, height)
            met = 0
            for row in range(begin_row, end_row):
                begin_column, end_column = tile_columns(splats, g, row, width)
                met += end_column - begin_column
                if row - begin_row < KEPT_SPANS:
                    records[g, R_SPANS + 2 * (row - begin_row)] = begin_column
                    records[g, R_SPANS + 2 * (row - begin_row) + 1] = end_column
            records[g, R_FIRST], records[g, R_ROWS] = begin_row, end_row - begin_row
            tile_counts[g] = met
            if met > 0:
                radius[g] = out[_RADIUS * TILE + g - first]
            else:
                status[g] = OUTSIDE


@exact
def tile_rows(splats, g, height):  # type: ignore[no-untyped-def]
    """First and one past the last row of tiles whose pixel centres the ellipse's box reaches."""
    y, half = splats[g, Y] - f32(0.5), splats[g, HALF_HEIGHT]
    first = np.ceil(min(max(y - half, f32(0.0)), height))
    last = np.floor(min(max(y + half, f32(-1.0)), height - f32(1.0)))
    if not first <= last:
        return 0, 0
    return int(first) // TILE_ROWS, int(last) // TILE_ROWS + 1


@exact
def tile_columns(splats, g, row, width):  # type: ignore[no-untyped-def]
    """First and one past the last tile in a row of tiles that the ellipse itself meets.

    The ellipse is (dx - shear dy)^2 + squeeze dy^2 = reach here. Its x-extent within the band of pixel
    centres [low, high] is at the row where it is widest, if that lies in the band, else at the band's nearer edge.
    """
    ratio = splats[g, RATIO]
    shear, squeeze, reach = splats[g, SHEAR] * ratio, splats[g, SQUEEZE] * ratio * ratio, splats[g, REACH] * ratio
    low = f32(row * TILE_ROWS) + f32(0.5) - splats[g, Y]
    high = low + f32(TILE_ROWS - 1)
    right = min(max(splats[g, TURN], low), high)
    left = min(max(-splats[g, TURN], low), high)
    beyond, before = reach - squeeze * right * right, reach - squeeze * left * left
    if not (beyond >= f32(0.0) and before >= f32(0.0)):
        return 0, 0
    x = splats[g, X] - f32(0.5)
    first = np.ceil(min(max(x + shear * left - np.sqrt(before), f32(0.0)), width))
    last = np.floor(min(max(x + shear * right + np.sqrt(beyond), f32(-1.0)), width - f32(1.0)))
    if not first <= last:
        return 0, 0
    return int(first) // TILE, int(last) // TILE + 1


@exact
def kept_columns(splats, records, g, row, width):  # type: ignore[no-untyped-def]
    """`tile_columns`, from the record that `project` kept where it did."""
    i = row - records[g, R_FIRST]
    if i < KEPT_SPANS:
        return np.int64(records[g, R_SPANS + 2 * i]), np.int64(records[g, R_SPANS + 2 * i + 1])
    return tile_columns(splats, g, row, width)
