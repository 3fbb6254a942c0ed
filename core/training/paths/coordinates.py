"""In what a path is learned: px of the photo at the scene's distance, for turns and translations alike."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...camera import Camera
from .slopes import Sampled


def px_units(camera: Camera) -> NDArray[np.float64]:
    """[6] twist that moves the picture by about a px: translations at distance 1, then turns."""
    px = 1.0 / camera.fx
    corner = 4.0 / math.hypot(camera.width, camera.height)
    return np.array([px, px, corner, px, px, corner])


def flow(camera: Camera, at: Sampled, depth: Tensor, units: Tensor) -> Tensor:
    """[2, 6, h, w] px of the grid, along x and along y, by which a px of motion in each axis moves what is seen.

    Args:
        camera: on the grid; depth: [h, w] of what is seen at these px, the scene's unit; units: [6] of `px_units`.
    """
    rows, columns = torch.arange(camera.height)[at.rows], torch.arange(camera.width)[at.columns]
    y, x = torch.meshgrid((rows + 0.5 - camera.cy) / camera.fy, (columns + 0.5 - camera.cx) / camera.fx, indexing="ij")
    du, dv = flow_at(x, y, 1.0 / depth)
    scale = camera.fx * units[:, None, None]
    return torch.stack([du * scale, dv * scale]).float()


def flow_at(x: Tensor, y: Tensor, near: Tensor) -> tuple[Tensor, Tensor]:
    """[6, ...] focal lengths along x, and along y, by which a unit of motion in each axis moves what is seen.

    Args:
        x, y: focal lengths from the photo's middle; near: 1 / depth; all of one shape.
    """
    zero = torch.zeros_like(x)
    du = torch.stack([near, zero, -near * x, -x * y, 1 + x * x, -y])
    dv = torch.stack([zero, near, -near * y, -(1 + y * y), x * y, x])
    return du, dv


def common_to(cameras: Sequence[Camera], fewest: int) -> Tensor:
    """[F, F] that leaves of values of F photos what all share, or what follows the place of the camera.

    Args:
        fewest: photos for each of up to four numbers that are common; with fewer, the mean is.
    """
    columns = np.ones((len(cameras), 1))
    if len(cameras) >= fewest * 4:
        places = np.stack([camera.centre for camera in cameras])
        columns = np.concatenate([columns, places - places.mean(axis=0)], axis=1)
    return torch.from_numpy(columns @ np.linalg.pinv(columns, rcond=1e-3)).float()


def backwards(twists: Tensor) -> Tensor:
    """Paths [..., M + 1, 6] run the other way."""
    return twists * torch.tensor([(-1.0) ** m for m in range(twists.shape[-2])])[:, None]
