"""Small rigid motions of a camera, as the optimizer steps them: the exponential of se(3)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor


def se3_exponential(twist: Tensor) -> Tensor:
    """Rigid motion of a twist (Sola et al., "A micro Lie theory", 2018, eq. 172).

    Args:
        twist: [..., 6] translational part (world units), then rotation vector (radians).

    Returns:
        [..., 3, 4] rotation and translation; smooth in the twist, also at zero.
    """
    generator = twist.new_zeros(*twist.shape[:-1], 4, 4)
    x, y, z = twist[..., 3], twist[..., 4], twist[..., 5]
    generator[..., 0, 1], generator[..., 0, 2], generator[..., 1, 2] = -z, y, -x
    generator[..., 1, 0], generator[..., 2, 0], generator[..., 2, 1] = z, -y, x
    generator[..., :3, 3] = twist[..., :3]
    return torch.linalg.matrix_exp(generator)[..., :3, :]


def moved_pose(twist: Tensor, pose: Tensor) -> Tensor:
    """The pose exp(twist) o pose: a correction expressed in the camera's own axes.

    Args:
        twist: [..., 6] as in `se3_exponential`.
        pose: [..., 3, 4] world to camera.

    Returns:
        [..., 3, 4] world to camera.
    """
    step = se3_exponential(twist)
    rotation = step[..., :3] @ pose[..., :3]
    translation = step[..., :3] @ pose[..., 3:] + step[..., 3:]
    return torch.cat([rotation, translation], dim=-1)


def twist_between(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """[6] the twist that moves one pose to another, both [3, 4] world to camera: `moved_pose` undone.

    Turns by less than pi (Sola et al. 2018, eq. 173).
    """
    turn = after[:, :3] @ before[:, :3].T
    vector = Rotation.from_matrix(turn).as_rotvec()
    angle, (x, y, z) = float(np.linalg.norm(vector)), vector
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # (series to the fourth power of the angle, where the quotients lose their digits)
    small = angle < 1e-3
    first = 0.5 - angle**2 / 24 if small else (1 - np.cos(angle)) / angle**2
    second = 1 / 6 - angle**2 / 120 if small else (angle - np.sin(angle)) / angle**3
    shift = np.linalg.solve(np.eye(3) + first * across + second * across @ across, after[:, 3] - turn @ before[:, 3])
    return np.concatenate([shift, vector])
