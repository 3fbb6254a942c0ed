"""Where a camera sees the twin's surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..camera import Camera
from ..forward import sharp_view
from ..gaussians import Gaussians
from ..rasterizer import RasterSettings

#: A px whose opacity is less has no surface.
SOLID = 0.7


def surface_depth(gaussians: Gaussians, camera: Camera, settings: RasterSettings) -> NDArray[np.float32]:
    """[H, W] depth along the axis, in the unit of both; NaN where there is no surface."""
    with torch.no_grad():
        seen = sharp_view(gaussians, camera, replace(settings, depth=True))
    assert seen.mean_depth is not None
    return np.where(seen.alpha.numpy() > SOLID, seen.mean_depth.numpy(), np.nan).astype(np.float32)
