"""The one place that converts axes. Everything in `core` is COLMAP's.

    COLMAP/OpenCV  camera: x right, y down, z forward.  Pose: world to camera, x_c = R x_w + t.
    OpenGL/NeRF    camera: x right, y up, z backward.   Pose: camera to world, 4x4 matrix.
    LLFF           camera: x down, y right, z backward. Pose: camera to world, 3x4 matrix.
    Blender        camera: as OpenGL, camera to world.  World: z up, right-handed.

The camera axes differ by AXES = diag(1, -1, -1) (its own inverse). The worlds of NeRF files and of
Blender are z up; COLMAP's world has no fixed up, so worlds are only turned where a function says so:
Blender's z up is y down turned by 90 degrees about x: (x, y, z) -> (x, z, -y).
Quaternions are w x y z, of unit length; q and -q are the same rotation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: OpenGL/Blender camera axes in COLMAP camera axes, and back.
AXES: Floats = np.diag([1.0, -1.0, -1.0])


def to_opengl(rotation: Floats, translation: Floats) -> Floats:
    """COLMAP's world-to-camera -> [4, 4] camera-to-world with OpenGL's (= Blender's) camera axes."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.T @ AXES
    matrix[:3, 3] = -rotation.T @ translation
    return matrix


def from_opengl(matrix: Floats) -> tuple[Floats, Floats]:
    """[4, 4] or [3, 4] camera-to-world with OpenGL axes -> COLMAP's rotation [3, 3], translation [3].

    A scale in the matrix is taken out; its rotation is made orthonormal.

    Raises:
        ValueError: the matrix is singular, mirrored or not finite.
    """
    matrix = np.asarray(matrix, float)
    if matrix.shape not in ((4, 4), (3, 4)) or not np.isfinite(matrix).all():
        raise ValueError("a pose must be a finite 4x4 or 3x4 matrix")
    linear = matrix[:3, :3]
    determinant = float(np.linalg.det(linear))
    if determinant <= 1e-12:
        raise ValueError("a pose must not be singular or mirrored")
    u, _, vt = np.linalg.svd(linear)
    rotation = (u @ vt @ AXES).T
    return rotation, -rotation @ matrix[:3, 3]


def from_llff(matrix: Floats) -> tuple[Floats, Floats]:
    """[3, 4] camera-to-world with LLFF's axes -> COLMAP's rotation [3, 3], translation [3].

    Raises:
        ValueError: as of `from_opengl`.
    """
    down, right, backward, centre = np.asarray(matrix, float).T
    return from_opengl(np.stack([right, -down, backward, centre], axis=1))


def quaternion_from_rotation(rotation: Floats) -> Floats:
    """[3, 3] -> [4] w x y z, w >= 0 (the eigenvector of Bar-Itzhack's matrix: stable everywhere)."""
    r = np.asarray(rotation, float)
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    x, y, z, w = np.linalg.eigh(k / 3.0)[1][:, -1]
    quaternion = np.array([w, x, y, z])
    return quaternion if w >= 0 else -quaternion


def rotation_from_quaternion(quaternion: Floats) -> Floats:
    """[4] w x y z -> [3, 3].

    Raises:
        ValueError: the quaternion has no length.
    """
    norm = float(np.linalg.norm(quaternion))
    if not norm > 1e-12:
        raise ValueError("a quaternion of length 0 has no direction")
    w, x, y, z = np.asarray(quaternion, float) / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
