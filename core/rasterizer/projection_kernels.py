"""Projecting Gaussians to the screen, forward and backward (Zwicker's EWA), in float64 inside.

Parameters and results are float32; what happens between them is computed in double, which costs
nothing in scalar code and keeps needles, discs and far-off splats exact (the determinant of a
needle's covariance is a small difference of large products).

Items of the parallel loops are blocks of `BLOCK` Gaussians, a size that does not depend on the
number of threads: partial sums for the pose are added in the same order on every machine.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel
from ..constants import (
    DETERMINANT_MINIMUM,
    FRUSTUM_MARGIN,
    LOG_SCALE_LIMIT,
    QUATERNION_MINIMUM_NORM,
    SH_C0,
    SH_C1,
    SH_C2,
    SH_C3,
    TILE,
    TILE_ROWS,
)
from .splat_kernels import (
    CONIC_A,
    CONIC_C,
    DEPTH,
    FALL,
    FIRST_ROW,
    LAST_ROW,
    OPACITY,
    REACH,
    RED,
    SHEAR,
    SQUEEZE,
    TIP,
    X,
    Y,
)

BLOCK = 256

#: For so many rows of tiles the columns are kept from the projection; two tiles are 64 px high.
KEPT_SPANS = 3

# Status of a Gaussian after projection; the index into `CULL_REASONS` where it was culled.
SEEN, NON_FINITE, BEHIND, TRANSPARENT, OUTSIDE, DEGENERATE = range(6)
CULL_REASONS = ("", "non_finite", "behind", "transparent", "outside", "degenerate")

# Layout of the view vector (float64): rotation row by row, translation, lens, frame, settings.
V_T, V_FX, V_FY, V_CX, V_CY, V_WIDTH, V_HEIGHT, V_NEAR, V_LOW_PASS, V_ANTIALIAS, V_ALPHA_MINIMUM = (
    9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21)  # fmt: skip
VIEW_LENGTH = 22

_C2_0, _C2_1, _C2_2, _C2_3, _C2_4 = SH_C2
_C3_0, _C3_1, _C3_2, _C3_3, _C3_4, _C3_5, _C3_6 = SH_C3


@inlined
def harmonics(count, x, y, z, basis):  # type: ignore[no-untyped-def]
    """Real spherical harmonics of a unit direction into `basis` [16] (3DGS's signs and order)."""
    basis[0] = SH_C0
    if count > 1:
        basis[1], basis[2], basis[3] = -SH_C1 * y, SH_C1 * z, -SH_C1 * x
    if count > 4:
        xx, yy, zz = x * x, y * y, z * z
        basis[4], basis[5] = _C2_0 * x * y, _C2_1 * y * z
        basis[6] = _C2_2 * (2.0 * zz - xx - yy)
        basis[7], basis[8] = _C2_3 * x * z, _C2_4 * (xx - yy)
        if count > 9:
            basis[9] = _C3_0 * y * (3.0 * xx - yy)
            basis[10] = _C3_1 * x * y * z
            basis[11] = _C3_2 * y * (4.0 * zz - xx - yy)
            basis[12] = _C3_3 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy)
            basis[13] = _C3_4 * x * (4.0 * zz - xx - yy)
            basis[14] = _C3_5 * z * (xx - yy)
            basis[15] = _C3_6 * x * (xx - 3.0 * yy)


@inlined
def harmonics_slope(count, x, y, z, weight, out):  # type: ignore[no-untyped-def]
    """Gradient of sum_k weight[k] basis_k w.r.t. the direction, into `out` [3]."""
    gx = gy = gz = 0.0
    if count > 1:
        gy += -SH_C1 * weight[1]
        gz += SH_C1 * weight[2]
        gx += -SH_C1 * weight[3]
    if count > 4:
        w = weight
        gx += _C2_0 * y * w[4] - 2.0 * _C2_2 * x * w[6] + _C2_3 * z * w[7] + 2.0 * _C2_4 * x * w[8]
        gy += _C2_0 * x * w[4] + _C2_1 * z * w[5] - 2.0 * _C2_2 * y * w[6] - 2.0 * _C2_4 * y * w[8]
        gz += _C2_1 * y * w[5] + 4.0 * _C2_2 * z * w[6] + _C2_3 * x * w[7]
        if count > 9:
            xx, yy, zz = x * x, y * y, z * z
            gx += (_C3_0 * 6.0 * x * y * w[9] + _C3_1 * y * z * w[10] - _C3_2 * 2.0 * x * y * w[11]
                   - _C3_3 * 6.0 * x * z * w[12] + _C3_4 * (4.0 * zz - 3.0 * xx - yy) * w[13]
                   + _C3_5 * 2.0 * x * z * w[14] + _C3_6 * 3.0 * (xx - yy) * w[15])  # fmt: skip
            gy += (_C3_0 * 3.0 * (xx - yy) * w[9] + _C3_1 * x * z * w[10] + _C3_2 * (4.0 * zz - xx - 3.0 * yy) * w[11]
                   - _C3_3 * 6.0 * y * z * w[12] - _C3_4 * 2.0 * x * y * w[13]
                   - _C3_5 * 2.0 * y * z * w[14] - _C3_6 * 6.0 * x * y * w[15])  # fmt: skip
            gz += (_C3_1 * x * y * w[10] + _C3_2 * 8.0 * y * z * w[11]
                   + _C3_3 * (6.0 * zz - 3.0 * xx - 3.0 * yy) * w[12] + _C3_4 * 8.0 * x * z * w[13]
                   + _C3_5 * (xx - yy) * w[14])  # fmt: skip
    out[0], out[1], out[2] = gx, gy, gz


@inlined
def rotation_of(w, x, y, z, r):  # type: ignore[no-untyped-def]
    """Rotation matrix [9] of a unit quaternion w x y z."""
    r[0], r[1], r[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[3], r[4], r[5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[6], r[7], r[8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@inlined
def sigmoid(logit):  # type: ignore[no-untyped-def]
    """1 / (1 + exp(-x)) without overflow."""
    if logit >= 0:
        return 1.0 / (1.0 + math.exp(-logit))
    e = math.exp(logit)
    return e / (1.0 + e)


@inlined
def all_finite(means, log_scales, quaternions, opacity_logits, sh, g):  # type: ignore[no-untyped-def]
    """Whether every parameter of Gaussian g is finite (one sum: Inf - Inf and NaN both show)."""
    total = np.float64(opacity_logits[g]) * 0.0
    for i in range(3):
        total += np.float64(means[g, i]) * 0.0 + np.float64(log_scales[g, i]) * 0.0
    for i in range(4):
        total += np.float64(quaternions[g, i]) * 0.0
    for k in range(sh.shape[1]):
        for i in range(3):
            total += np.float64(sh[g, k, i]) * 0.0
    return math.isfinite(total)


# Scratch of one Gaussian's projection (float64), shared by forward and backward:
_P, _RQ, _S, _V, _U, _RX, _RY, _QN, _IN_X, _IN_Y, _D, _DET, _COMP, _O = (
    0, 3, 12, 15, 24, 30, 31, 32, 33, 34, 35, 36, 37, 38)  # fmt: skip
SCRATCH = 40


@inlined
def geometry(view, means, log_scales, quaternions, opacity_logits, g, s):  # type: ignore[no-untyped-def]
    """Everything about one Gaussian's shape on the screen, into scratch `s`; returns its status."""
    for i in range(3):
        s[_P + i] = (view[3 * i] * means[g, 0] + view[3 * i + 1] * means[g, 1] + view[3 * i + 2] * means[g, 2]
                     + view[V_T + i])  # fmt: skip
    x, y, z = s[_P], s[_P + 1], s[_P + 2]
    if not z > view[V_NEAR]:
        return BEHIND
    qw, qx, qy, qz = (np.float64(quaternions[g, 0]), np.float64(quaternions[g, 1]),
                      np.float64(quaternions[g, 2]), np.float64(quaternions[g, 3]))  # fmt: skip
    norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    if not norm >= QUATERNION_MINIMUM_NORM:
        return DEGENERATE
    s[_QN] = norm
    rotation_of(qw / norm, qx / norm, qy / norm, qz / norm, s[_RQ : _RQ + 9])
    for j in range(3):
        s[_S + j] = math.exp(min(max(np.float64(log_scales[g, j]), -LOG_SCALE_LIMIT), LOG_SCALE_LIMIT))
    for i in range(3):
        for j in range(3):
            s[_V + 3 * i + j] = (view[3 * i] * s[_RQ + j] + view[3 * i + 1] * s[_RQ + 3 + j]
                                 + view[3 * i + 2] * s[_RQ + 6 + j]) * s[_S + j]  # fmt: skip
    fx, fy = view[V_FX], view[V_FY]
    mx, my = FRUSTUM_MARGIN * view[V_WIDTH], FRUSTUM_MARGIN * view[V_HEIGHT]
    rx, ry = x / z, y / z
    s[_RX] = min(max(rx, -(view[V_CX] + mx) / fx), (view[V_WIDTH] - view[V_CX] + mx) / fx)
    s[_RY] = min(max(ry, -(view[V_CY] + my) / fy), (view[V_HEIGHT] - view[V_CY] + my) / fy)
    s[_IN_X] = 1.0 if s[_RX] == rx else 0.0
    s[_IN_Y] = 1.0 if s[_RY] == ry else 0.0
    for j in range(3):
        s[_U + j] = fx / z * (s[_V + j] - s[_RX] * s[_V + 6 + j])
        s[_U + 3 + j] = fy / z * (s[_V + 3 + j] - s[_RY] * s[_V + 6 + j])
    u0, u1, u2, w0, w1, w2 = s[_U], s[_U + 1], s[_U + 2], s[_U + 3], s[_U + 4], s[_U + 5]
    c0, c1, c2 = u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0
    # det(U U^T) = |u x w|^2 (Cauchy-Binet): exact for needles, where a c - b b cancels
    s[_D] = c0 * c0 + c1 * c1 + c2 * c2
    trace = u0 * u0 + u1 * u1 + u2 * u2 + w0 * w0 + w1 * w1 + w2 * w2
    low = view[V_LOW_PASS]
    s[_DET] = s[_D] + low * trace + low * low
    # 1 / trace has to stay a normal float32; the determinant itself is never stored
    if not (s[_DET] >= DETERMINANT_MINIMUM and trace < 1e36):
        return DEGENERATE
    s[_COMP] = math.sqrt(s[_D] / s[_DET]) if view[V_ANTIALIAS] > 0 else 1.0
    s[_O] = sigmoid(np.float64(opacity_logits[g]))
    return SEEN


@inlined
def surely_outside(view, means, log_scales, g):  # type: ignore[no-untyped-def]
    """Whether even a fully opaque Gaussian of this size could not reach the frame: a cheap first test.

    A row of the Jacobian is no longer than f / z sqrt(1 + r^2), r the clamped direction, so the
    half-extent is at most sqrt(cutoff (|row|^2 s^2 + low_pass)) with s the largest scale.
    """
    x = view[0] * means[g, 0] + view[1] * means[g, 1] + view[2] * means[g, 2] + view[V_T]
    y = view[3] * means[g, 0] + view[4] * means[g, 1] + view[5] * means[g, 2] + view[V_T + 1]
    z = view[6] * means[g, 0] + view[7] * means[g, 1] + view[8] * means[g, 2] + view[V_T + 2]
    if not z > view[V_NEAR]:
        return False  # told apart from BEHIND elsewhere
    fx, fy, width, height = view[V_FX] / z, view[V_FY] / z, view[V_WIDTH], view[V_HEIGHT]
    u, v = fx * x + view[V_CX], fy * y + view[V_CY]
    if u > 0 and u < width and v > 0 and v < height:
        return False
    alpha_minimum = view[V_ALPHA_MINIMUM] if view[V_ALPHA_MINIMUM] > 0 else 1e-12
    cutoff = -2.0 * math.log(alpha_minimum)
    largest = math.exp(min(max(log_scales[g, 0], log_scales[g, 1], log_scales[g, 2]), LOG_SCALE_LIMIT))
    rx = (1.0 + FRUSTUM_MARGIN) * max(view[V_CX], width - view[V_CX], width) / view[V_FX]
    ry = (1.0 + FRUSTUM_MARGIN) * max(view[V_CY], height - view[V_CY], height) / view[V_FY]
    reach_x = math.sqrt(cutoff * (fx * fx * (1.0 + rx * rx) * largest * largest + view[V_LOW_PASS]))
    reach_y = math.sqrt(cutoff * (fy * fy * (1.0 + ry * ry) * largest * largest + view[V_LOW_PASS]))
    return u + reach_x < 0 or u - reach_x > width or v + reach_y < 0 or v - reach_y > height


@kernel
def project(begin, end, view, means, log_scales, quaternions, opacity_logits, sh, splats, status, radius,
            tile_counts, spans):  # type: ignore[no-untyped-def]  # fmt: skip
    """Projects blocks `begin` to `end` of `BLOCK` Gaussians.

    Args:
        view: [22] float64, see `V_*`.
        splats: [N, 16] output rows for the blending kernels (only those with status SEEN).
        status: [N] uint8 output.
        radius: [N] float32 output, half-extent in px, 0 where culled.
        tile_counts: [N] int32 output, how many tiles the ellipse meets.
        spans: [N, 2 KEPT_SPANS] int16 output, first and one past the last tile of its first rows of tiles.
    """
    count = sh.shape[1]
    s = np.empty(SCRATCH, np.float64)
    basis = np.empty(16, np.float64)
    centre = np.empty(3, np.float64)
    for i in range(3):
        centre[i] = -(view[i] * view[V_T] + view[3 + i] * view[V_T + 1] + view[6 + i] * view[V_T + 2])
    alpha_minimum = view[V_ALPHA_MINIMUM] if view[V_ALPHA_MINIMUM] > 0 else 1e-12
    for g in range(begin * BLOCK, min(end * BLOCK, means.shape[0])):
        radius[g] = np.float32(0)
        tile_counts[g] = 0
        if not all_finite(means, log_scales, quaternions, opacity_logits, sh, g):
            status[g] = NON_FINITE
            continue
        if surely_outside(view, means, log_scales, g):
            status[g] = OUTSIDE
            continue
        state = geometry(view, means, log_scales, quaternions, opacity_logits, g, s)
        if state != SEEN:
            status[g] = state
            continue
        opacity = s[_O] * s[_COMP]
        if not opacity > alpha_minimum:
            status[g] = TRANSPARENT
            continue
        cutoff = 2.0 * math.log(opacity / alpha_minimum)
        low = view[V_LOW_PASS]
        a = s[_U] * s[_U] + s[_U + 1] * s[_U + 1] + s[_U + 2] * s[_U + 2] + low
        b = s[_U] * s[_U + 3] + s[_U + 1] * s[_U + 4] + s[_U + 2] * s[_U + 5]
        c = s[_U + 3] * s[_U + 3] + s[_U + 4] * s[_U + 4] + s[_U + 5] * s[_U + 5] + low
        x = view[V_FX] * s[_P] / s[_P + 2] + view[V_CX]
        y = view[V_FY] * s[_P + 1] / s[_P + 2] + view[V_CY]
        half_x, half_y = math.sqrt(cutoff * a), math.sqrt(cutoff * c)
        if not (x + half_x > 0 and x - half_x < view[V_WIDTH] and y + half_y > 0 and y - half_y < view[V_HEIGHT]):
            status[g] = OUTSIDE
            continue
        splat = splats[g]
        splat[X], splat[Y] = np.float32(x), np.float32(y)
        splat[CONIC_A] = np.float32(c / s[_DET])
        splat[FALL] = np.float32(math.expm1(-a / s[_DET]))
        splat[CONIC_C] = np.float32(a / s[_DET])
        splat[OPACITY] = np.float32(opacity)
        splat[DEPTH] = np.float32(s[_P + 2])
        splat[SHEAR] = np.float32(b / a)
        splat[SQUEEZE] = np.float32(s[_DET] / (a * a))
        # a hair more, so that rounding never skips a row whose alpha still counts
        splat[REACH] = np.float32((cutoff * 1.0001 + 1e-4) * s[_DET] / a)
        splat[TIP] = np.float32(b / c * half_y)
        splat[FIRST_ROW] = np.float32(min(max(math.ceil(y - half_y - 0.5), 0.0), view[V_HEIGHT]))
        splat[LAST_ROW] = np.float32(min(max(math.floor(y + half_y - 0.5) + 1.0, 0.0), view[V_HEIGHT]))
        dx, dy, dz = means[g, 0] - centre[0], means[g, 1] - centre[1], means[g, 2] - centre[2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        harmonics(count, dx / length, dy / length, dz / length, basis)
        for channel in range(3):
            value = 0.5
            for k in range(count):
                value += basis[k] * sh[g, k, channel]
            splat[RED + channel] = np.float32(max(value, 0.0))
        status[g] = SEEN
        radius[g] = np.float32(max(half_x, half_y))
        first, last = tile_rows(splat)
        met = 0
        for row in range(first, last):
            begin_x, end_x = tile_columns(splat, row, view[V_WIDTH])
            met += end_x - begin_x
            if row - first < KEPT_SPANS:
                spans[g, 2 * (row - first)], spans[g, 2 * (row - first) + 1] = begin_x, end_x
        tile_counts[g] = met
        if met == 0:
            status[g] = OUTSIDE
            radius[g] = np.float32(0)


@inlined
def tile_rows(splat):  # type: ignore[no-untyped-def]
    """First and one past the last row of tiles whose pixel centres the ellipse's box reaches."""
    first, last = int(splat[FIRST_ROW]), int(splat[LAST_ROW])
    if last <= first:
        return 0, 0
    return first // TILE_ROWS, (last - 1) // TILE_ROWS + 1


@inlined
def tile_columns(splat, row, width):  # type: ignore[no-untyped-def]
    """First and one past the last tile in a row of tiles that the ellipse itself meets.

    The ellipse's x-extent within the band of pixel centres [low, high] is at the row where it is
    widest, if that lies in the band, else at the band's nearer edge.
    """
    a, c = np.float64(splat[CONIC_A]), np.float64(splat[CONIC_C])
    b = -c * splat[SHEAR]
    cutoff = np.float64(splat[REACH]) * c
    low = row * TILE_ROWS + 0.5 - splat[Y]
    high = low + (TILE_ROWS - 1)
    widest = math.sqrt(max(cutoff * c / max(a * c - b * b, 1e-300), 0.0))
    turn = -b / c * widest  # dy at the rightmost point; the leftmost is at -turn
    right = extent(a, b, c, cutoff, min(max(turn, low), high), 1.0)
    left = extent(a, b, c, cutoff, min(max(-turn, low), high), -1.0)
    if not left <= right:
        return 0, 0
    first = max(math.ceil(max(splat[X] + left - 0.5, -1.0)), 0.0)
    last = min(math.floor(min(splat[X] + right - 0.5, width + 1.0)), width - 1)
    if last < first:
        return 0, 0
    return int(first) // TILE, int(last) // TILE + 1


@inlined
def kept_columns(splats, spans, g, first, row, width):  # type: ignore[no-untyped-def]
    """`tile_columns`, from the spans that `project` kept where it did."""
    if row - first < KEPT_SPANS:
        return np.int64(spans[g, 2 * (row - first)]), np.int64(spans[g, 2 * (row - first) + 1])
    return tile_columns(splats[g], row, width)


@inlined
def extent(a, b, c, cutoff, dy, side):  # type: ignore[no-untyped-def]
    """Where a dx^2 + 2 b dx dy + c dy^2 = cutoff crosses dy, on the given side; +-inf reversed if nowhere."""
    root = b * dy * b * dy - a * (c * dy * dy - cutoff)
    if root < 0:
        return -side * math.inf
    return (-b * dy + side * math.sqrt(root)) / a
