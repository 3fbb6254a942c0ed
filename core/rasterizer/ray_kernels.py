"""Where Gaussians are densest along a camera's rays, as `blend_depths` wants it."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel

# Layout of a Gaussian's row of `rays`: K [3, 3] row by row, K m [3], and the depths that it may lie between.
K_M, LOW, HIGH, RAY_WIDTH = 9, 12, 13, 16


@kernel
def place_rays(begin, end, means, log_scales, quaternions, pose, thinnest, reach, rays):  # type: ignore[no-untyped-def]
    """Rows `begin` to `end` of rays; what is no number becomes 0.

    Args:
        means, log_scales: [N, 3] float32; quaternions: [N, 4] float32, w x y z, any length but zero.
        pose: [12] float64, R row by row and t, world to camera.
        thinnest: share of its longest axis that a Gaussian is thick at least; reach: standard deviations.
        rays: [N, 16] float32 output.
    """
    q, scales, points = np.empty(4), np.empty(3), np.empty(3)
    own, turned = np.empty((3, 3)), np.empty((3, 3))
    for n in range(begin, end):
        longest = 0.0
        for axis in range(3):
            scales[axis] = math.exp(min(max(float(log_scales[n, axis]), -40.0), 40.0))
            longest = max(longest, scales[axis])
            points[axis] = pose[9 + axis]
            for k in range(3):
                points[axis] += pose[3 * axis + k] * means[n, k]
        for k in range(4):
            q[k] = quaternions[n, k]
        _rotation(q, own)
        deep = 0.0
        for axis in range(3):
            for row in range(3):
                turned[row, axis] = 0.0
                for k in range(3):
                    turned[row, axis] += pose[3 * row + k] * own[k, axis]
            deep += (turned[2, axis] * scales[axis]) ** 2
        square = 0.0
        for axis in range(3):
            along = 0.0
            for k in range(3):
                turned[k, axis] /= max(scales[axis], thinnest * longest)
                along += turned[k, axis] * points[k]
            scales[axis] = along
            square += along * along
        length = max(math.sqrt(square), 1e-30)
        for axis in range(3):
            for k in range(3):
                rays[n, 3 * axis + k] = _number(turned[k, axis] / length)
            rays[n, K_M + axis] = _number(scales[axis] / length)
        deep = reach * math.sqrt(deep)
        rays[n, LOW], rays[n, HIGH] = _number(max(points[2] - deep, 0.0)), _number(points[2] + deep)
        for k in range(HIGH + 1, RAY_WIDTH):
            rays[n, k] = 0.0


@inlined
def _rotation(q, matrix):  # type: ignore[no-untyped-def]
    """The matrix [3, 3] of a quaternion, also where the square of its length leaves the range of floats."""
    largest = max(max(abs(q[0]), abs(q[1])), max(abs(q[2]), abs(q[3])))
    w, x, y, z = q[0] / largest, q[1] / largest, q[2] / largest, q[3] / largest
    length = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@inlined
def _number(value):  # type: ignore[no-untyped-def]
    """A value, 0 for what is none."""
    return np.float32(value) if value == value else np.float32(0.0)
