"""Small rigid motions of a camera, as the optimizer steps them: the exponential of se(3)."""

from __future__ import annotations

import torch
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
