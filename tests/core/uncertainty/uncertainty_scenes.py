"""A tiny plane of splats, seen by some cameras and not by others."""

from __future__ import annotations

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import RasterSettings
from dgs.core.uncertainty.candidates import looking_at
from dgs.core.uncertainty.linear_model import LinearModel, Viewpoint

WIDTH, HEIGHT = 48, 32
LENS = Camera("", WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
UP = np.array([0.0, -1.0, 0.0])


def plane(spacing: float = 0.12, half: float = 0.9) -> Gaussians:
    """A square of splats at z = 0, opaque, of random colours."""
    x, y = np.meshgrid(np.arange(-half, half, spacing), np.arange(-half, half, spacing))
    n = x.size
    random = np.random.default_rng(0)
    means = np.stack([x.ravel(), y.ravel(), np.zeros(n)], axis=1)
    return Gaussians(
        torch.tensor(means, dtype=torch.float32),
        torch.full((n, 3), float(np.log(spacing / 2))),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n, 1),
        torch.full((n,), 2.0),
        torch.tensor(random.uniform(-0.6, 0.6, (n, 1, 3)), dtype=torch.float32),
    )


def camera(x: float, z: float = -2.0, look: float | None = None) -> Camera:
    """At (x, 0, z), looking at (look, 0, 0)."""
    focus = np.array([x if look is None else look, 0.0, 0.0])
    return looking_at(LENS, f"at {x:g} {z:g}", np.array([x, 0.0, z]), focus, UP)


def linear_model_at(cameras: list[Camera], sigma: float, spacing: float = 0.12) -> LinearModel:
    """The plane through a blur of `sigma` px."""
    gaussians = plane(spacing)
    psf = PointSpread("gaussian", sigma, sigma) if sigma else None
    viewpoints = [Viewpoint(c, psf) for c in cameras]
    return LinearModel(gaussians, viewpoints, 6 if sigma else 0, torch.zeros(3), RasterSettings(low_pass=0.3))
