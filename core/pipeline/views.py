"""Renders a twin as a photo's own lens sees it, sharp or through the medium."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor

from ..camera import Camera
from ..constants import LOW_PASS_VARIANCE
from ..gaussians import Gaussians
from ..imaging.medium import Medium
from ..imaging.operator import BlurOperator
from ..lens import Lens
from ..rasterizer import RasterSettings, render
from ..sfm.reconstruction import Pose
from ..training.scale import SceneScale

#: The lens is evaluated every so many px and interpolated: it bends far too little to notice.
_STRIDE = 8
#: A frame that distortion makes larger than this many times the photo is cut.
_LARGEST_FRAME = 3.0

Planes = NDArray[np.float32]


class Viewer:
    """Renders one twin from any lens and pose.

    Args:
        gaussians: the twin in world units.
        scale: the scene's own units, in which the rasterizer's near plane is meant.
        device: where to render.
        low_pass: variance in px^2 that the projection adds; the training's, or the usual one of
            viewers.
    """

    def __init__(
        self, gaussians: Gaussians, scale: SceneScale, device: str, low_pass: float = LOW_PASS_VARIANCE
    ) -> None:
        self._gaussians = scale.to_unit(gaussians).to(device)
        self._scale = scale
        self._low_pass = low_pass

    def sharp(self, lens: Lens, pose: Pose, margin: int = 0, finer: float = 1.0) -> Tensor:
        """[3, H + 2 margin, W + 2 margin] float32, sRGB, with the lens's distortion.

        `finer` tells how many times finer the lens's grid is than the one that `low_pass` is meant on.
        """
        settings = RasterSettings(low_pass=self._low_pass * finer**2)
        if lens.largest_shift() < 0.01:
            camera = Camera(
                "", lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, pose.rotation, pose.translation
            )
            return self._pinhole(camera.with_margin(margin), settings)
        positions, width, height, left, top = _straight_frame(lens, margin)
        camera = Camera(
            "", width, height, lens.fx, lens.fy, lens.cx - left, lens.cy - top, pose.rotation, pose.translation
        )
        straight = self._pinhole(camera, settings)
        bent = [map_coordinates(plane, positions, order=3, mode="nearest") for plane in straight.cpu().numpy()]
        return torch.from_numpy(np.stack(bent)).to(straight.device)

    def degraded(self, lens: Lens, pose: Pose, medium: Medium, name: str) -> Tensor:
        """[3, H, W] float32, sRGB: what the camera would see of the twin through the medium."""
        psf = medium.psf_for(name)
        margin = 0 if psf is None or psf.is_identity else max(psf.radius)
        frame = self.sharp(lens, pose, margin)
        operator = BlurOperator(psf, lens.height, lens.width, margin, frame.device, frame.dtype)
        return medium.degrade(frame, operator.apply)

    def _pinhole(self, camera: Camera, settings: RasterSettings) -> Tensor:
        with torch.no_grad():
            return render(self._gaussians, self._scale.camera_to_unit(camera), settings=settings).image


def to_pixels(planes: Tensor) -> NDArray[np.uint8]:
    """[3, H, W] in [0, 1] -> [H, W, 3] uint8, rounded."""
    values = (planes.detach().clamp(0, 1) * 255).round().to(torch.uint8)
    return np.ascontiguousarray(values.permute(1, 2, 0).cpu().numpy())


@lru_cache(maxsize=4)
def _straight_frame(lens: Lens, margin: int) -> tuple[Planes, int, int, int, int]:
    """Where each pixel of the photo (with a margin) lies in an undistorted frame.

    Returns:
        positions [2, H + 2m, W + 2m] (row, column) in the frame; the frame's width, height, left and
        top in px of the photo's pinhole grid.
    """
    columns = np.arange(-margin, lens.width + margin + _STRIDE, _STRIDE, dtype=np.float64)
    rows = np.arange(-margin, lens.height + margin + _STRIDE, _STRIDE, dtype=np.float64)
    grid = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), axis=-1)
    ideal = lens.from_pixels(grid)
    plain = (grid - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
    # Beyond a strong lens's edge no ray arrives; those pixels show what lies straight ahead of them.
    straight = np.where(np.isfinite(ideal), ideal, plain) * [lens.fx, lens.fy] + [lens.cx, lens.cy]
    reach_x, reach_y = lens.width * (_LARGEST_FRAME - 1) / 2, lens.height * (_LARGEST_FRAME - 1) / 2
    low = np.maximum(np.floor(straight.min(axis=(0, 1))) - 2, [-reach_x, -reach_y]).astype(int)
    high = np.minimum(np.ceil(straight.max(axis=(0, 1))) + 2, [lens.width + reach_x, lens.height + reach_y]).astype(int)
    y, x = np.mgrid[: lens.height + 2 * margin, : lens.width + 2 * margin] / _STRIDE
    position = [
        map_coordinates(straight[:, :, axis] - low[axis] - 0.5, [y, x], order=1, mode="nearest") for axis in (1, 0)
    ]
    width, height = (high - low).tolist()
    return np.stack(position).astype(np.float32), int(width), int(height), int(low[0]), int(low[1])
