"""Gaussians moved as a whole: centres, shapes and harmonics together. Needs numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cloud import GaussianCloud
from ..constants import SH_C0, SH_C1, SH_C2, SH_C3

#: Signs of harmonics 1 to 15 when y and z are turned round.
FLIP = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)
#: Directions that determine the seven harmonics of degree 3 well.
_DIRECTIONS = 64


def flipped(cloud: GaussianCloud) -> GaussianCloud:
    """Half a turn about x: y and z change their signs. Exact; twice gives what was there before."""
    signs = np.array([1.0, -1.0, -1.0], np.float32)
    sh = cloud.sh.copy()
    sh[:, 1:] *= FLIP[: sh.shape[1] - 1, None]
    # As a rotation about x by pi, seen from both sides: (w, x, y, z) becomes (w, x, -y, -z).
    turn = np.array([1.0, 1.0, -1.0, -1.0], np.float32)
    return GaussianCloud(cloud.means * signs, cloud.log_scales, cloud.quaternions * turn, cloud.opacity_logits, sh)


def moved(
    cloud: GaussianCloud, rotation: NDArray[np.float64], scale: float, translation: NDArray[np.float64]
) -> GaussianCloud:
    """x becomes scale * rotation @ x + translation.

    Args:
        cloud: the Gaussians.
        rotation: [3, 3] proper rotation.
        scale: factor, positive.
        translation: [3].
    """
    means = scale * cloud.means.astype(np.float64) @ rotation.T + translation
    quaternions = _product(_quaternion(rotation), cloud.quaternions.astype(np.float64))
    return GaussianCloud(
        means.astype(np.float32),
        (cloud.log_scales + np.log(scale)).astype(np.float32),
        quaternions.astype(np.float32),
        cloud.opacity_logits,
        rotated_harmonics(cloud.sh, rotation),
    )


def rotated_harmonics(sh: NDArray[np.float32], rotation: NDArray[np.float64]) -> NDArray[np.float32]:
    """[N, K, 3] coefficients of the same colours in turned axes: colour'(R d) = colour(d).

    Harmonics of one degree turn into harmonics of that degree only: a matrix for each, found from the
    values in many directions.
    """
    random = np.random.default_rng(0).normal(size=(_DIRECTIONS, 3))
    directions = random / np.linalg.norm(random, axis=1, keepdims=True)
    before, after = harmonics(directions), harmonics(directions @ rotation.T)
    turned = sh.copy()
    for degree in range(1, int(np.sqrt(sh.shape[1]))):
        part = slice(degree**2, (degree + 1) ** 2)
        matrix = np.linalg.lstsq(after[:, part], before[:, part], rcond=None)[0]
        turned[:, part] = np.einsum("ij,njc->nic", matrix, sh[:, part])
    return turned


def harmonics(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N, 16] real harmonics up to degree 3 in unit `directions` [N, 3], signed and ordered as in 3DGS files."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    values = [
        np.full_like(x, SH_C0),
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        SH_C2[0] * x * y,
        SH_C2[1] * y * z,
        SH_C2[2] * (2 * zz - xx - yy),
        SH_C2[3] * x * z,
        SH_C2[4] * (xx - yy),
        SH_C3[0] * y * (3 * xx - yy),
        SH_C3[1] * x * y * z,
        SH_C3[2] * y * (4 * zz - xx - yy),
        SH_C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
        SH_C3[4] * x * (4 * zz - xx - yy),
        SH_C3[5] * z * (xx - yy),
        SH_C3[6] * x * (xx - 3 * yy),
    ]
    return np.stack(values, axis=1)


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """w x y z of a rotation: the eigenvector of Bar-Itzhack's matrix, exact for every angle."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    largest: NDArray[np.float64] = np.linalg.eigh(k)[1][:, -1]
    return largest[[3, 0, 1, 2]]


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hamilton's product of one quaternion with many, [N, 4] w x y z."""
    w, x, y, z = a
    bw, bx, by, bz = b.T
    return np.stack(
        [
            w * bw - x * bx - y * by - z * bz,
            w * bx + x * bw + y * bz - z * by,
            w * by - x * bz + y * bw + z * bx,
            w * bz + x * by - y * bx + z * bw,
        ],
        axis=1,
    )
