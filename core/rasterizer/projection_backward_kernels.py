"""Projecting Gaussians to the screen, backward: from gradients on the screen to the parameters, sixteen at once.

The mirror of `projection_kernels` and `shape_kernels`; the comments name the step that each part undoes.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import kernel
from ..constants import TILE
from ..lanes_kernels import Buffer, Lanes, Running, choose, transposed
from .projection_kernels import BLOCK, SEEN
from .shape_kernels import (
    P_LOG_SCALE,
    P_LOGIT,
    P_MEAN,
    P_QUATERNION,
    P_SH,
    PARAMETER_PLANES,
    V_LOW_PASS,
    V_T,
    Planes,
    Shape,
    View,
    gathered,
    harmonics,
    harmonics_gradient,
)
from .splat_kernels import M_ALL, M_RED, M_X, M_XX, M_XY, M_Y, M_YY, SLOT_WIDTH

f32 = np.float32
# Planes that `_chain` reads: 16 rows of sums over slots, whom to chain at all, the gradient of the depth; and works in:
# harmonics and their weights.
_SEEN, _DEPTH, _BASIS, _WEIGHT, _PLANES = 16, 17, 18, 34, 50
# Planes of gradients: those of the parameters, behind them the screen's.
_SCREEN = PARAMETER_PLANES
# Sums for the pose: rotation, translation, the camera's centre.
_POSE = 15


@intrinsic
def _sum_slots(typing_context, slots, first, last, work, row):  # type: ignore[no-untyped-def]
    """Sums `slots[first:last]` into row `row` of `work`; reads beyond a slot, so `slots` is a row longer."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        table = Buffer(context, builder, signature.args[0], arguments[0])
        out = Buffer(context, builder, signature.args[3], arguments[3])
        total = Running(builder, 1)
        one = ir.Constant(ir.IntType(64), 1)
        with cgutils.for_range_slice(builder, arguments[1], arguments[2], one, inc=True) as (slot, _):
            total.add(0, table.row(builder.mul(slot, ir.Constant(slot.type, SLOT_WIDTH))))
        out.put_row(builder.mul(arguments[4], ir.Constant(ir.IntType(64), TILE)), 0, total[0])
        return context.get_dummy_value()

    i = types.int64
    return types.void(slots, i, i, work, i), generate


@intrinsic
def _chain(typing_context, view, parameters, count, work, out, pose):  # type: ignore[no-untyped-def]
    """Gradients of 16 Gaussians' parameters into planes `out`, those of the pose added to `pose` [15, 16]."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        view = View(context, builder, signature.args[0], arguments[0])
        planes, work, out = (Planes(context, builder, signature.args[n], arguments[n]) for n in (1, 3, 4))
        pose = Buffer(context, builder, signature.args[5], arguments[5])
        zero, one = (ir.Constant(ir.IntType(64), n) for n in (0, 1))
        shape = Shape(view, planes)
        seen = work[_SEEN].compare(">", 0.0)
        only = lambda lanes: choose(seen, lanes, 0.0)  # noqa: E731
        sums = transposed([work[k] for k in range(TILE)])
        moment = lambda k: sums[k].double()  # noqa: E731

        def to_pose(position: int, lanes: Lanes) -> None:
            pose.put_row(zero, position * TILE, pose.row(zero, position * TILE) + only(lanes))

        # alpha = opacity exp(-0.5 d^T K d), d from the centre
        a0, b, c0, low = shape.a0, shape.b, shape.c0, view[V_LOW_PASS]
        inverse = shape.inverse_determinant
        ka, kb, kc = shape.c * inverse, -b * inverse, shape.a * inverse
        g_x, g_y = ka * moment(M_X) + kb * moment(M_Y), kb * moment(M_X) + kc * moment(M_Y)
        ga, gb, gc = -0.5 * moment(M_XX), -0.5 * moment(M_XY), -0.5 * moment(M_YY)
        out[_SCREEN], out[_SCREEN + 1] = only(g_x.single()), only(g_y.single())

        # conic -> covariance: H = -K G K
        left0, left1 = ka * ga + kb * gb, ka * gb + kb * gc
        right0, right1 = kb * ga + kc * gb, kb * gb + kc * gc
        h00, h01, h11 = -(ka * left0 + kb * left1), -(ka * right0 + kb * right1), -(kb * right0 + kc * right1)
        total = moment(M_ALL)
        out[P_LOGIT] = only((total * (1.0 - shape.opacity)).single())
        filtered = builder.and_(shape.antialias, shape.share.compare(">", 1e-12))
        factor = choose(filtered, total * 0.5 * inverse / shape.share, 0.0)
        h00 = h00 + factor * (c0 - shape.share * (c0 + low))
        h11 = h11 + factor * (a0 - shape.share * (a0 + low))
        h01 = h01 - factor * b * (1.0 - shape.share)

        # covariance = U U^T, U = J V
        x, y, _ = shape.point
        focal_x, focal_y, inverse_z = shape.focal_x, shape.focal_y, shape.inverse_z
        d_u = [2.0 * (h00 * shape.u[j] + h01 * shape.w[j]) for j in range(3)]
        d_w = [2.0 * (h01 * shape.u[j] + h11 * shape.w[j]) for j in range(3)]
        d_v = [focal_x * d for d in d_u] + [focal_y * d for d in d_w]
        d_v += [-1.0 * (shape.rx * d_v[j] + shape.ry * d_v[3 + j]) for j in range(3)]
        dot = lambda left, right: left[0] * right[0] + left[1] * right[1] + left[2] * right[2]  # noqa: E731
        d_rx = choose(shape.inside_x, -focal_x * dot(d_u, shape.v[6:]), 0.0)
        d_ry = choose(shape.inside_y, -focal_y * dot(d_w, shape.v[6:]), 0.0)
        d_point = [focal_x * g_x + d_rx * inverse_z, focal_y * g_y + d_ry * inverse_z]
        # (U is proportional to 1 / z at fixed rx, ry)
        d_point.append(
            work[_DEPTH].double()
            - inverse_z * (x * d_point[0] + y * d_point[1] + dot(d_u, shape.u) + dot(d_w, shape.w))
        )

        # V = R M, M = Rq S
        d_r = [d_point[0]] * 9
        for j in range(3):
            d_m = [view[k] * d_v[j] + view[3 + k] * d_v[3 + j] + view[6 + k] * d_v[6 + j] for k in range(3)]
            d_s = dot(d_m, shape.axes[j::3])
            out[P_LOG_SCALE + j] = only(choose(shape.free[j], d_s, 0.0).single())
            for k in range(3):
                d_r[3 * k + j] = d_m[k] * shape.scale[j]
        for i in range(3):
            for k in range(3):  # dR = dV M^T, and p = R m + t
                by_axes = dot(d_v[3 * i : 3 * i + 3], shape.axes[3 * k : 3 * k + 3])
                to_pose(3 * i + k, by_axes + d_point[i] * shape.mean[k])
            to_pose(V_T + i, d_point[i])
        for k, d in enumerate(_quaternion_gradient(shape.unit, d_r)):
            out[P_QUATERNION + k] = only((d / shape.norm).single())

        # colour
        look = [component.single() for component in shape.look]
        for k, value in enumerate(harmonics(*look)):
            work[_BASIS + k] = value
        colour = [sums[M_RED + channel] for channel in range(3)]
        row = lambda buffer, plane, k, step: buffer.row(  # noqa: E731
            builder.mul(k, ir.Constant(k.type, step * TILE)), plane * TILE
        )
        lit = Running(builder, 3)
        with cgutils.for_range_slice(builder, zero, arguments[2], one, inc=True) as (k, _):
            value = row(work.buffer, _BASIS, k, 1)
            for channel in range(3):
                lit.add(channel, value * row(planes.buffer, P_SH + channel, k, 3))
        # a colour below black is black whatever its coefficients
        colour = [choose((lit[channel] + 0.5).compare(">", 0.0), colour[channel], 0.0) for channel in range(3)]
        with cgutils.for_range_slice(builder, zero, arguments[2], one, inc=True) as (k, _):
            value, to = row(work.buffer, _BASIS, k, 1), builder.mul(k, ir.Constant(k.type, 3 * TILE))
            weight = value * 0.0
            for channel in range(3):
                out.buffer.put_row(to, (P_SH + channel) * TILE, only(colour[channel] * value))
                weight = weight + colour[channel] * row(planes.buffer, P_SH + channel, k, 3)
            work.buffer.put_row(builder.mul(k, ir.Constant(k.type, TILE)), _WEIGHT * TILE, weight)
        gradient = [s.double() for s in harmonics_gradient(*look, [work[_WEIGHT + k] for k in range(16)])]
        along = dot(gradient, shape.look)
        by_look = [(s - along * v) * shape.inverse_distance for s, v in zip(gradient, shape.look, strict=True)]
        for k in range(3):
            to_pose(V_T + 3 + k, by_look[k])
            chained = view[k] * d_point[0] + view[3 + k] * d_point[1] + view[6 + k] * d_point[2]
            out[P_MEAN + k] = only((chained + by_look[k]).single())
        return context.get_dummy_value()

    return types.void(view, parameters, types.int64, work, out, pose), generate


def _quaternion_gradient(unit: list[Lanes], r: list[Lanes]) -> list[Lanes]:
    """From the gradient of a rotation matrix to that of its unit quaternion, across its length."""
    w, x, y, z = unit
    turn_x, turn_y, turn_z = r[7] - r[5], r[2] - r[6], r[3] - r[1]
    xy, xz, yz = r[1] + r[3], r[2] + r[6], r[5] + r[7]
    d = [
        2.0 * (x * turn_x + y * turn_y + z * turn_z),
        2.0 * (w * turn_x + y * xy + z * xz - 2.0 * x * (r[4] + r[8])),
        2.0 * (w * turn_y + x * xy + z * yz - 2.0 * y * (r[0] + r[8])),
        2.0 * (w * turn_z + x * xz + y * yz - 2.0 * z * (r[0] + r[4])),
    ]
    along = d[0] * w + d[1] * x + d[2] * y + d[3] * z
    return [d_k - along * q for d_k, q in zip(d, unit, strict=True)]


@kernel
def project_backward(
    begin,
    end,
    view,
    means,
    log_scales,
    quaternions,
    opacity_logits,
    sh,
    status,
    slot_starts,
    slots,
    depth_gradient,
    d_means,
    d_log_scales,
    d_quaternions,
    d_opacity_logits,
    d_sh,
    d_screen,
    d_view,
):  # type: ignore[no-untyped-def]
    """Chains screen-space gradients to the parameters, for blocks `begin` to `end`.

    Args:
        slot_starts: [N + 1] int64, each Gaussian's range in `slots` [P + 2, 9] (the last two are never used).
        depth_gradient: [N] float32 gradient w.r.t. the centre's depth, or [0] if there is none.
        d_*: outputs, the parameters' shapes; every row is written.
        d_screen: [N, 2] output, gradient w.r.t. the projected centre in px.
        d_view: [blocks, 12] output, gradient w.r.t. rotation (row by row) and translation.
    """
    parameters = np.empty(PARAMETER_PLANES * TILE, np.float32)
    work = np.zeros(_PLANES * TILE, np.float32)
    out = np.empty((_SCREEN + 2) * TILE, np.float32)
    pose = np.empty((_POSE, TILE), np.float64)
    sums = np.empty(_POSE, np.float64)
    with_depth = depth_gradient.shape[0] > 0
    for block in range(begin, end):
        pose[:] = 0.0
        stop = min((block + 1) * BLOCK, means.shape[0])
        for first in range(block * BLOCK, stop, TILE):
            last = min(first + TILE, stop)
            for i in range(TILE):
                g = first + i
                seen = g < last and status[g] == SEEN
                work[_SEEN * TILE + i] = f32(1.0) if seen else f32(0.0)
                work[_DEPTH * TILE + i] = depth_gradient[g] if seen and with_depth else f32(0.0)
                if seen:
                    _sum_slots(slots, slot_starts[g], slot_starts[g + 1], work, i)
                else:
                    _sum_slots(slots, 0, 0, work, i)
            gathered(means, log_scales, quaternions, opacity_logits, sh, first, last, parameters)
            _chain(view, parameters, sh.shape[1], work, out, pose)
            for g in range(first, last):
                i = g - first
                for k in range(3):
                    d_means[g, k] = out[(P_MEAN + k) * TILE + i]
                    d_log_scales[g, k] = out[(P_LOG_SCALE + k) * TILE + i]
                for k in range(4):
                    d_quaternions[g, k] = out[(P_QUATERNION + k) * TILE + i]
                d_opacity_logits[g] = out[P_LOGIT * TILE + i]
                for k in range(sh.shape[1]):
                    for channel in range(3):
                        d_sh[g, k, channel] = out[(P_SH + 3 * k + channel) * TILE + i]
                d_screen[g, 0], d_screen[g, 1] = out[_SCREEN * TILE + i], out[(_SCREEN + 1) * TILE + i]
        for k in range(_POSE):
            sums[k] = pose[k].sum()
        # the camera's centre -R^T t, of which every direction is the negative
        for k in range(3):
            for j in range(3):
                sums[3 * k + j] += view[V_T + k] * sums[V_T + 3 + j]
                sums[V_T + k] += view[3 * k + j] * sums[V_T + 3 + j]
        d_view[block, :] = sums[:12]
