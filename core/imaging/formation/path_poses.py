"""Where a camera stands along its path; the mathematics of `motion`, apart from it as it loads torch."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...camera import Camera
from ...pose import Pose
from ...rigid_motion import moved_pose
from .row_windows import over_photo, row_weights, was_turned


def polynomials(times: Tensor, order: int) -> Tensor:
    """[T, order + 1] Legendre's polynomials over the exposure, at times [T] in [-1/2, 1/2]."""
    x = 2.0 * times
    found = [torch.ones_like(x), x]
    for m in range(1, order):
        found.append(((2 * m + 1) * x * found[m] - m * found[m - 1]) / (m + 1))
    return torch.stack(found[: order + 1], dim=1)


def middles(count: int) -> Tensor:
    """[count] times of so many frames of equal length, in [-1/2, 1/2]."""
    return (torch.arange(count, dtype=torch.float32) + 0.5) / count - 0.5


def shares_of_rows(count: int, height: int, width: int, readout: float, margin: int) -> Tensor:
    """[count, height + 2 margin, 1] or [count, 1, width + 2 margin] float32 of `row_weights`."""
    rows = row_weights(count, min(height, width), torch.tensor(readout), margin)
    return over_photo(rows, was_turned(height, width))


def poses_on(twists: Tensor, camera: Camera, times: Tensor) -> Tensor:
    """[T, 3, 4] world to camera at times [T] of a path [M + 1, 6] that begins at a camera."""
    pose = torch.from_numpy(np.column_stack([camera.rotation, camera.translation])).to(twists.dtype)
    return moved_pose(polynomials(times, len(twists) - 1) @ twists, pose.expand(len(times), 3, 4))


def mean_twist(twists: Tensor, count: int) -> Tensor:
    """[6] float64, mean over `count` frames of a path [M + 1, 6]."""
    return polynomials(middles(count).double(), len(twists) - 1).mean(dim=0) @ twists.cpu().double()


def mean_pose(twists: Tensor, pose: Pose, count: int) -> Pose:
    """Where a camera was on average over `count` frames of a path [M + 1, 6] that begins at its pose."""
    still = torch.from_numpy(np.column_stack([pose.rotation, pose.translation]))
    moved = moved_pose(mean_twist(twists, count), still).numpy()
    return Pose(moved[:, :3], moved[:, 3])


def way_on(twists: Tensor, unit: float, focal: float, count: int) -> Tensor:
    """[count, 2] px along x and y by which a path [M + 1, 6] leads what is in the middle of the photo."""
    twist = polynomials(torch.linspace(-0.5, 0.5, count), len(twists) - 1) @ twists
    return focal * torch.stack([twist[:, 0] / unit + twist[:, 4], twist[:, 1] / unit - twist[:, 3]], dim=1)


def straight(ways: list[tuple[float, float]], order: int) -> Tensor:
    """[V, order + 1, 6] paths that turn the camera so that the photo's middle moves along (x, y), in focal lengths."""
    twists = torch.zeros(len(ways), order + 1, 6)
    for row, (x, y) in zip(twists, ways, strict=True):
        row[1, 4], row[1, 3] = x / 2, -y / 2
    return twists
