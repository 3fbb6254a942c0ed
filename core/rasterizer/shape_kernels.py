"""Sixteen Gaussians' shapes on the screen at once (Zwicker's EWA), shared by the forward and the backward pass.

Parameters and results are float32; what happens between them is computed in double, which keeps
needles, discs and far-off splats exact (the determinant of a needle's covariance is a small
difference of large products). Colours are float32 throughout.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from ..compiled import inlined
from ..constants import (
    DETERMINANT_MINIMUM,
    FAR_PLANE,
    FRUSTUM_MARGIN,
    LOG_SCALE_LIMIT,
    QUATERNION_MINIMUM_NORM,
    SH_C0,
    SH_C1,
    SH_C2,
    SH_C3,
    TILE,
)
from ..lanes_kernels import Buffer, Lanes, choose, constant, exponential, maximum, minimum, root

# Layout of the view vector (float64): rotation row by row, translation, lens, frame, settings, the camera's centre.
(V_T, V_FX, V_FY, V_CX, V_CY, V_WIDTH, V_HEIGHT, V_NEAR, V_LOW_PASS, V_ANTIALIAS, V_ALPHA_MINIMUM, V_CENTRE) = (
    9,
    12,
    13,
    14,
    15,
    16,
    17,
    18,
    19,
    20,
    21,
    22,
)
VIEW_LENGTH = 25

# Planes of 16 values, one per parameter: what `gathered` lays out.
P_MEAN, P_LOG_SCALE, P_QUATERNION, P_LOGIT, P_SH = 0, 3, 6, 10, 11
PARAMETER_PLANES = P_SH + 3 * 16

_C2_0, _C2_1, _C2_2, _C2_3, _C2_4 = SH_C2
_C3_0, _C3_1, _C3_2, _C3_3, _C3_4, _C3_5, _C3_6 = SH_C3


@inlined
def gathered(means, log_scales, quaternions, opacity_logits, sh, first, last, planes):  # type: ignore[no-untyped-def]
    """Parameters of Gaussians `first` to `last` (at most 16) into `planes`; the last fills what is left."""
    for i in range(TILE):
        g = min(first + i, last - 1)
        for k in range(3):
            planes[(P_MEAN + k) * TILE + i] = means[g, k]
            planes[(P_LOG_SCALE + k) * TILE + i] = log_scales[g, k]
        for k in range(4):
            planes[(P_QUATERNION + k) * TILE + i] = quaternions[g, k]
        planes[P_LOGIT * TILE + i] = opacity_logits[g]
        for k in range(sh.shape[1]):
            for channel in range(3):
                planes[(P_SH + 3 * k + channel) * TILE + i] = sh[g, k, channel]


class Planes:
    """A float32 array of planes of 16 values."""

    def __init__(self, context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value) -> None:
        self.buffer = Buffer(context, builder, array_type, array)
        self.zero = ir.Constant(ir.IntType(64), 0)

    def __getitem__(self, plane: int) -> Lanes:
        return self.buffer.row(self.zero, plane * TILE)

    def __setitem__(self, plane: int, lanes: Lanes) -> None:
        self.buffer.put_row(self.zero, plane * TILE, lanes.wide())


class View:
    """The view vector's numbers as scalars."""

    def __init__(self, context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value) -> None:
        self.buffer = Buffer(context, builder, array_type, array)

    def __getitem__(self, index: int) -> Lanes:
        return self.buffer.one(ir.Constant(ir.IntType(64), index))


class Shape:
    """Everything about 16 Gaussians on the screen, in double; `fits` and the masks before it say for whom it holds."""

    def __init__(self, view: View, planes: Planes) -> None:
        builder = planes.buffer.builder
        read = lambda first, count: [planes[first + k].double() for k in range(count)]  # noqa: E731
        self.mean, log_scales, quaternion = read(P_MEAN, 3), read(P_LOG_SCALE, 3), read(P_QUATERNION, 4)
        mx, my, mz = self.mean
        # in this order for every Gaussian: equal points must get equal depths
        self.point = [view[3 * i] * mx + view[3 * i + 1] * my + view[3 * i + 2] * mz + view[V_T + i] for i in range(3)]
        x, y, z = self.point
        self.in_front = z.compare(">", view[V_NEAR])
        self.norm = root(sum((q * q for q in quaternion[1:]), quaternion[0] * quaternion[0]))
        self.has_direction = self.norm.compare(">=", QUATERNION_MINIMUM_NORM)
        self.unit = [q / self.norm for q in quaternion]
        self.turn = _rotation(*self.unit)
        limit = LOG_SCALE_LIMIT
        self.scale = [exponential(minimum(maximum(s, -limit), limit)) for s in log_scales]
        self.free = [builder.and_(s.compare("<", limit), s.compare(">", -limit)) for s in log_scales]

        # V = R Rq S and U = J V
        self.axes = [self.turn[k] * self.scale[k % 3] for k in range(9)]
        self.v = [
            view[3 * i] * self.axes[j] + view[3 * i + 1] * self.axes[3 + j] + view[3 * i + 2] * self.axes[6 + j]
            for i in range(3)
            for j in range(3)
        ]
        self.inverse_z = 1.0 / z
        self.focal_x, self.focal_y = view[V_FX] * self.inverse_z, view[V_FY] * self.inverse_z
        rx, ry = x * self.inverse_z, y * self.inverse_z
        width, height, cx, cy = view[V_WIDTH], view[V_HEIGHT], view[V_CX], view[V_CY]
        self.rx = minimum(
            maximum(rx, -(cx + FRUSTUM_MARGIN * width) / view[V_FX]), (width - cx + FRUSTUM_MARGIN * width) / view[V_FX]
        )
        self.ry = minimum(
            maximum(ry, -(cy + FRUSTUM_MARGIN * height) / view[V_FY]),
            (height - cy + FRUSTUM_MARGIN * height) / view[V_FY],
        )
        self.inside_x, self.inside_y = rx.compare("==", self.rx), ry.compare("==", self.ry)
        self.u = [self.focal_x * (self.v[j] - self.rx * self.v[6 + j]) for j in range(3)]
        self.w = [self.focal_y * (self.v[3 + j] - self.ry * self.v[6 + j]) for j in range(3)]

        # det(U U^T) = |u x w|^2 (Cauchy-Binet): exact for needles, where a c - b b cancels
        u, w, low = self.u, self.w, view[V_LOW_PASS]
        cross = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]]
        dot = lambda left, right: left[0] * right[0] + left[1] * right[1] + left[2] * right[2]  # noqa: E731
        self.bare = dot(cross, cross)
        self.a0, self.b, self.c0 = dot(u, u), dot(u, w), dot(w, w)
        trace = self.a0 + self.c0
        self.determinant = self.bare + low * trace + low * low
        self.a, self.c = self.a0 + low, self.c0 + low
        # 1 / trace has to stay a normal float32; the determinant itself is never stored
        sound = builder.and_(self.determinant.compare(">=", DETERMINANT_MINIMUM), trace.compare("<", 1e36))
        sound = builder.and_(sound, z.compare("<", FAR_PLANE))
        self.fits = builder.and_(self.has_direction, sound)
        self.inverse_determinant = 1.0 / self.determinant
        self.antialias = view[V_ANTIALIAS].wide().compare(">", 0.0)
        self.share = choose(self.antialias, self.bare * self.inverse_determinant, 1.0)
        self.opacity = 1.0 / (1.0 + exponential(-planes[P_LOGIT].double()))

        # the direction that the camera looks along
        look = [m - view[V_CENTRE + k] for k, m in enumerate(self.mean)]
        self.inverse_distance = 1.0 / root(dot(look, look))
        self.look = [component * self.inverse_distance for component in look]


def _rotation(w: Lanes, x: Lanes, y: Lanes, z: Lanes) -> list[Lanes]:
    """Rotation matrix of unit quaternions w x y z, row by row."""
    return [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    ]


def harmonics(x: Lanes, y: Lanes, z: Lanes) -> list[Lanes]:
    """The 16 real spherical harmonics of unit directions (3DGS's signs and order)."""
    xx, yy, zz = x * x, y * y, z * z
    return [
        constant(x.builder, SH_C0),
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        _C2_0 * x * y,
        _C2_1 * y * z,
        _C2_2 * (2.0 * zz - xx - yy),
        _C2_3 * x * z,
        _C2_4 * (xx - yy),
        _C3_0 * y * (3.0 * xx - yy),
        _C3_1 * x * y * z,
        _C3_2 * y * (4.0 * zz - xx - yy),
        _C3_3 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        _C3_4 * x * (4.0 * zz - xx - yy),
        _C3_5 * z * (xx - yy),
        _C3_6 * x * (xx - 3.0 * yy),
    ]


def harmonics_gradient(x: Lanes, y: Lanes, z: Lanes, w: list[Lanes]) -> list[Lanes]:
    """Gradient of sum_k w[k] harmonics[k] with respect to the direction."""
    xx, yy, zz = x * x, y * y, z * z
    gx = (
        -SH_C1 * w[3]
        + _C2_0 * y * w[4]
        - 2.0 * _C2_2 * x * w[6]
        + _C2_3 * z * w[7]
        + 2.0 * _C2_4 * x * w[8]
        + _C3_0 * 6.0 * x * y * w[9]
        + _C3_1 * y * z * w[10]
        - _C3_2 * 2.0 * x * y * w[11]
        - _C3_3 * 6.0 * x * z * w[12]
        + _C3_4 * (4.0 * zz - 3.0 * xx - yy) * w[13]
        + _C3_5 * 2.0 * x * z * w[14]
        + _C3_6 * 3.0 * (xx - yy) * w[15]
    )
    gy = (
        -SH_C1 * w[1]
        + _C2_0 * x * w[4]
        + _C2_1 * z * w[5]
        - 2.0 * _C2_2 * y * w[6]
        - 2.0 * _C2_4 * y * w[8]
        + _C3_0 * 3.0 * (xx - yy) * w[9]
        + _C3_1 * x * z * w[10]
        + _C3_2 * (4.0 * zz - xx - 3.0 * yy) * w[11]
        - _C3_3 * 6.0 * y * z * w[12]
        - _C3_4 * 2.0 * x * y * w[13]
        - _C3_5 * 2.0 * y * z * w[14]
        - _C3_6 * 6.0 * x * y * w[15]
    )
    gz = (
        SH_C1 * w[2]
        + _C2_1 * y * w[5]
        + 4.0 * _C2_2 * z * w[6]
        + _C2_3 * x * w[7]
        + _C3_1 * x * y * w[10]
        + _C3_2 * 8.0 * y * z * w[11]
        + _C3_3 * (6.0 * zz - 3.0 * xx - 3.0 * yy) * w[12]
        + _C3_4 * 8.0 * x * z * w[13]
        + _C3_5 * (xx - yy) * w[14]
    )
    return [gx, gy, gz]
