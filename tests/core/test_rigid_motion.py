"""The exponential of se(3) against closed forms and finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from dgs.core.rigid_motion import moved_pose, se3_exponential, twist_between


def test_zero_twist_is_the_identity_with_a_gradient() -> None:
    twist = torch.zeros(6, requires_grad=True)
    motion = se3_exponential(twist)
    assert torch.equal(motion.detach(), torch.eye(4)[:3])
    motion.sum().backward()
    assert twist.grad is not None and bool(twist.grad.isfinite().all())


def test_pure_translation_and_quarter_turn() -> None:
    moved = se3_exponential(torch.tensor([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))
    assert torch.allclose(moved[:, 3], torch.tensor([1.0, 2.0, 3.0]))
    turned = se3_exponential(torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, math.pi / 2]))
    assert torch.allclose(turned[:, :3] @ torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 1.0, 0.0]), atol=1e-6)


def test_screw_motion_closes_after_a_whole_turn() -> None:
    """A turn about z with speed along x and z: x cancels, z adds up."""
    twist = torch.tensor([1.0, 0.0, 0.5, 0.0, 0.0, 2 * math.pi], dtype=torch.float64)
    motion = se3_exponential(twist)
    expected = torch.tensor([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5]], dtype=torch.float64)
    assert torch.allclose(motion, expected, atol=1e-12)


def test_gradients_of_moved_poses() -> None:
    random = torch.Generator().manual_seed(0)
    twist = torch.randn(2, 6, dtype=torch.float64, generator=random, requires_grad=True)
    pose = torch.randn(2, 3, 4, dtype=torch.float64, generator=random, requires_grad=True)
    assert torch.autograd.gradcheck(moved_pose, (twist, pose))


def test_motions_are_applied_in_camera_axes() -> None:
    """exp(twist) o pose moves the camera point of every world point by exp(twist)."""
    random = torch.Generator().manual_seed(1)
    pose = se3_exponential(torch.randn(6, dtype=torch.float64, generator=random))
    twist = torch.randn(6, dtype=torch.float64, generator=random)
    point = torch.randn(3, dtype=torch.float64, generator=random)
    in_camera = pose[:, :3] @ point + pose[:, 3]
    step = se3_exponential(twist)
    moved = moved_pose(twist, pose)
    assert torch.allclose(moved[:, :3] @ point + moved[:, 3], step[:, :3] @ in_camera + step[:, 3])


@pytest.mark.parametrize("size", [0.0, 1e-7, 9e-4, 1.1e-3, 0.3, 3.0])
def test_the_twist_between_two_poses_moves_one_to_the_other(size: float) -> None:
    random = np.random.default_rng(0)
    turn = random.standard_normal(3)
    twist = np.concatenate([size * random.standard_normal(3), size * turn / np.linalg.norm(turn)])
    pose = se3_exponential(torch.from_numpy(random.standard_normal(6)))
    moved = moved_pose(torch.from_numpy(twist), pose)
    assert np.abs(twist_between(pose.numpy(), moved.numpy()) - twist).max() < 1e-9
