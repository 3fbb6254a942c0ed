"""Projecting Gaussians to the screen, backward: from gradients on the screen to the parameters.

The mirror of `projection_kernels.project`; the comments name the step of it that each part undoes.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
from ..constants import LOG_SCALE_LIMIT
from .projection_kernels import (
    _COMP,
    _D,
    _DET,
    _IN_X,
    _IN_Y,
    _O,
    _P,
    _QN,
    _RQ,
    _RX,
    _RY,
    _S,
    _U,
    _V,
    BLOCK,
    SCRATCH,
    SEEN,
    V_ANTIALIAS,
    V_FX,
    V_FY,
    V_LOW_PASS,
    V_T,
    geometry,
    harmonics,
    harmonics_slope,
)
from .splat_kernels import (
    BLUE,
    GREEN,
    M_ALL,
    M_BLUE,
    M_GREEN,
    M_RED,
    M_X,
    M_XX,
    M_XY,
    M_Y,
    M_YY,
    RED,
    SLOT_WIDTH,
)


@kernel
def project_backward(begin, end, view, means, log_scales, quaternions, opacity_logits, sh, splats, status,
                     slot_starts, slots, depth_gradient, d_means, d_log_scales, d_quaternions, d_opacity_logits, d_sh,
                     d_screen, d_view):  # type: ignore[no-untyped-def]  # fmt: skip
    """Chains screen-space gradients to the parameters, for blocks `begin` to `end`.

    Args:
        slot_starts: [N + 1] int64, each Gaussian's range in `slots` [P, 9].
        depth_gradient: [N] float32 gradient w.r.t. the centre's depth, or [0] if there is none.
        d_*: outputs, the parameters' shapes; every row is written.
        d_screen: [N, 2] output, gradient w.r.t. the projected centre in px.
        d_view: [blocks, 12] output, gradient w.r.t. rotation (row by row) and translation.
    """
    count = sh.shape[1]
    s = np.empty(SCRATCH, np.float64)
    sums = np.empty(SLOT_WIDTH, np.float64)
    basis = np.empty(16, np.float64)
    weight = np.empty(16, np.float64)
    slope = np.empty(3, np.float64)
    gradient_v = np.empty(9, np.float64)
    gradient_p = np.empty(3, np.float64)
    gradient_r = np.empty(9, np.float64)
    centre = np.empty(3, np.float64)
    with_depth = depth_gradient.shape[0] > 0
    for i in range(3):
        centre[i] = -(view[i] * view[V_T] + view[3 + i] * view[V_T + 1] + view[6 + i] * view[V_T + 2])
    for block in range(begin, end):
        d_view[block, :] = 0.0
        d_centre_x = d_centre_y = d_centre_z = 0.0
        for g in range(block * BLOCK, min((block + 1) * BLOCK, means.shape[0])):
            d_screen[g, :] = np.float32(0)
            if status[g] != SEEN:
                d_means[g, :] = np.float32(0)
                d_log_scales[g, :] = np.float32(0)
                d_quaternions[g, :] = np.float32(0)
                d_opacity_logits[g] = np.float32(0)
                d_sh[g, :, :] = np.float32(0)
                continue
            geometry(view, means, log_scales, quaternions, opacity_logits, g, s)
            for k in range(SLOT_WIDTH):
                sums[k] = 0.0
            for slot in range(slot_starts[g], slot_starts[g + 1]):
                for k in range(SLOT_WIDTH):
                    sums[k] += slots[slot, k]
            # (the conic anew in double: in float32 a long needle's small eigenvalue is lost)
            a0 = s[_U] * s[_U] + s[_U + 1] * s[_U + 1] + s[_U + 2] * s[_U + 2]
            b0 = s[_U] * s[_U + 3] + s[_U + 1] * s[_U + 4] + s[_U + 2] * s[_U + 5]
            c0 = s[_U + 3] * s[_U + 3] + s[_U + 4] * s[_U + 4] + s[_U + 5] * s[_U + 5]
            low = view[V_LOW_PASS]
            ka, kb, kc = (c0 + low) / s[_DET], -b0 / s[_DET], (a0 + low) / s[_DET]

            # alpha = opacity exp(-0.5 d^T K d), d from the centre
            g_x, g_y = ka * sums[M_X] + kb * sums[M_Y], kb * sums[M_X] + kc * sums[M_Y]
            ga, gb, gc = -0.5 * sums[M_XX], -0.5 * sums[M_XY], -0.5 * sums[M_YY]
            x, y, z = s[_P], s[_P + 1], s[_P + 2]
            fx, fy = view[V_FX], view[V_FY]
            d_screen[g, 0], d_screen[g, 1] = np.float32(g_x), np.float32(g_y)
            gradient_p[0] = fx / z * g_x
            gradient_p[1] = fy / z * g_y
            gradient_p[2] = -(fx * x * g_x + fy * y * g_y) / (z * z)
            if with_depth:
                gradient_p[2] += depth_gradient[g]

            # conic -> covariance: H = -K G K with G = [[dA, dB / 2], [dB / 2, dC]]
            splat = splats[g]
            h00 = -(ka * (ka * ga + kb * gb) + kb * (ka * gb + kb * gc))
            h01 = -(ka * (kb * ga + kc * gb) + kb * (kb * gb + kc * gc))
            h11 = -(kb * (kb * ga + kc * gb) + kc * (kb * gb + kc * gc))
            opacity = s[_O]
            if view[V_ANTIALIAS] > 0 and s[_COMP] > 1e-6:
                factor = sums[M_ALL] * 0.5 / (s[_COMP] * s[_COMP]) / s[_DET]
                share = s[_D] / s[_DET]
                h00 += factor * (c0 - share * (c0 + low))
                h11 += factor * (a0 - share * (a0 + low))
                h01 -= factor * b0 * (1.0 - share)
            d_opacity_logits[g] = np.float32(sums[M_ALL] * (1.0 - opacity))

            # covariance = U U^T, U = J V, V = R Rq S
            d_u_z = d_w_z = d_scale_x = d_scale_y = 0.0
            for j in range(3):
                d_u = 2.0 * (h00 * s[_U + j] + h01 * s[_U + 3 + j])
                d_w = 2.0 * (h01 * s[_U + j] + h11 * s[_U + 3 + j])
                gradient_v[j] = fx / z * d_u
                gradient_v[3 + j] = fy / z * d_w
                gradient_v[6 + j] = -fx / z * s[_RX] * d_u - fy / z * s[_RY] * d_w
                d_scale_x += d_u * s[_U + j]  # U is proportional to 1/z at fixed rx
                d_scale_y += d_w * s[_U + 3 + j]
                d_u_z += d_u * s[_V + 6 + j]
                d_w_z += d_w * s[_V + 6 + j]
            gradient_p[2] -= (d_scale_x + d_scale_y) / z
            d_rx, d_ry = -fx / z * d_u_z * s[_IN_X], -fy / z * d_w_z * s[_IN_Y]
            gradient_p[0] += d_rx / z
            gradient_p[1] += d_ry / z
            gradient_p[2] -= (d_rx * x + d_ry * y) / (z * z)

            # V = R M, M = Rq S
            for j in range(3):
                d_m0 = view[0] * gradient_v[j] + view[3] * gradient_v[3 + j] + view[6] * gradient_v[6 + j]
                d_m1 = view[1] * gradient_v[j] + view[4] * gradient_v[3 + j] + view[7] * gradient_v[6 + j]
                d_m2 = view[2] * gradient_v[j] + view[5] * gradient_v[3 + j] + view[8] * gradient_v[6 + j]
                scale = s[_S + j]
                d_s = d_m0 * s[_RQ + j] + d_m1 * s[_RQ + 3 + j] + d_m2 * s[_RQ + 6 + j]
                inside = abs(log_scales[g, j]) < LOG_SCALE_LIMIT
                d_log_scales[g, j] = np.float32(d_s * scale if inside else 0.0)
                gradient_r[j], gradient_r[3 + j], gradient_r[6 + j] = d_m0 * scale, d_m1 * scale, d_m2 * scale
                for i in range(3):
                    for k in range(3):  # dR = dV M^T
                        d_view[block, 3 * i + k] += gradient_v[3 * i + j] * s[_RQ + 3 * k + j] * scale
            norm = s[_QN]
            qw, qx, qy, qz = (quaternions[g, 0] / norm, quaternions[g, 1] / norm,
                              quaternions[g, 2] / norm, quaternions[g, 3] / norm)  # fmt: skip
            r = gradient_r
            dw = 2.0 * (qx * (r[7] - r[5]) + qy * (r[2] - r[6]) + qz * (r[3] - r[1]))
            dx = 2.0 * (qw * (r[7] - r[5]) + qy * (r[1] + r[3]) + qz * (r[2] + r[6]) - 2.0 * qx * (r[4] + r[8]))
            dy = 2.0 * (qw * (r[2] - r[6]) + qx * (r[1] + r[3]) + qz * (r[5] + r[7]) - 2.0 * qy * (r[0] + r[8]))
            dz = 2.0 * (qw * (r[3] - r[1]) + qx * (r[2] + r[6]) + qy * (r[5] + r[7]) - 2.0 * qz * (r[0] + r[4]))
            along = dw * qw + dx * qx + dy * qy + dz * qz
            d_quaternions[g, 0] = np.float32((dw - along * qw) / norm)
            d_quaternions[g, 1] = np.float32((dx - along * qx) / norm)
            d_quaternions[g, 2] = np.float32((dy - along * qy) / norm)
            d_quaternions[g, 3] = np.float32((dz - along * qz) / norm)

            # colour
            vx, vy, vz = means[g, 0] - centre[0], means[g, 1] - centre[1], means[g, 2] - centre[2]
            length = math.sqrt(vx * vx + vy * vy + vz * vz)
            vx, vy, vz = vx / length, vy / length, vz / length
            harmonics(count, vx, vy, vz, basis)
            red = sums[M_RED] if splat[RED] > 0 else 0.0
            green = sums[M_GREEN] if splat[GREEN] > 0 else 0.0
            blue = sums[M_BLUE] if splat[BLUE] > 0 else 0.0
            for k in range(count):
                d_sh[g, k, 0] = np.float32(basis[k] * red)
                d_sh[g, k, 1] = np.float32(basis[k] * green)
                d_sh[g, k, 2] = np.float32(basis[k] * blue)
                weight[k] = red * sh[g, k, 0] + green * sh[g, k, 1] + blue * sh[g, k, 2]
            harmonics_slope(count, vx, vy, vz, weight, slope)
            along = slope[0] * vx + slope[1] * vy + slope[2] * vz
            cx, cy, cz = (slope[0] - along * vx) / length, (slope[1] - along * vy) / length, (
                slope[2] - along * vz) / length  # fmt: skip
            d_centre_x -= cx
            d_centre_y -= cy
            d_centre_z -= cz

            # p = R m + t
            for k in range(3):
                d_view[block, V_T + k] += gradient_p[k]
                for i in range(3):
                    d_view[block, 3 * k + i] += gradient_p[k] * means[g, i]
            d_means[g, 0] = np.float32(view[0] * gradient_p[0] + view[3] * gradient_p[1] + view[6] * gradient_p[2] + cx)
            d_means[g, 1] = np.float32(view[1] * gradient_p[0] + view[4] * gradient_p[1] + view[7] * gradient_p[2] + cy)
            d_means[g, 2] = np.float32(view[2] * gradient_p[0] + view[5] * gradient_p[1] + view[8] * gradient_p[2] + cz)
        # the camera's centre -R^T t
        for j in range(3):
            d_view[block, 3 * j] -= view[V_T + j] * d_centre_x
            d_view[block, 3 * j + 1] -= view[V_T + j] * d_centre_y
            d_view[block, 3 * j + 2] -= view[V_T + j] * d_centre_z
            d_view[block, V_T + j] -= (view[3 * j] * d_centre_x + view[3 * j + 1] * d_centre_y
                                       + view[3 * j + 2] * d_centre_z)  # fmt: skip
