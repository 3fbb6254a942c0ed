"""Renders a twin as a photo's own lens sees it, sharp or through the medium."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..constants import LOW_PASS_VARIANCE
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..imaging.medium import Medium
from ..imaging.operator import BlurOperator
from ..lens import Lens
from ..photos.undistort import Undistortion
from ..pose import Pose
from ..rasterizer import RasterSettings, Rendered, render
from ..training.scale import SceneScale

#: Pixels around a frame that interpolation at its border reads.
_SPLINE = 3
#: Light from farther than so many standard deviations outside a photo is not missed in it.
_REACH_SIGMAS = 3.0


class Viewer:
    """Renders one twin from any lens and pose.

    Args:
        gaussians: the twin in world units.
        scale: the scene's own units, in which the rasterizer's near plane is meant.
        device: where to render.
        low_pass: variance in px^2 that the projection adds; the training's, or the usual one of
            viewers.
        background: sRGB colour behind the twin.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        scale: SceneScale,
        device: str,
        low_pass: float = LOW_PASS_VARIANCE,
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._background = torch.tensor(background, device=device)
        self._gaussians = scale.to_unit(gaussians).to(device)
        self._scale = scale
        self._low_pass = low_pass

    def sharp(self, lens: Lens, pose: Pose, finer: float = 1.0) -> NDArray[np.float32]:
        """[3, H, W] sRGB, with the lens's distortion.

        `finer` tells how many times finer the lens's grid is than the one that `low_pass` is meant on.
        """
        settings = RasterSettings(low_pass=self._low_pass * finer**2)
        undistortion = _undistortion(lens)
        margin = undistortion.overscan + _SPLINE
        frame = self._pinhole(undistortion.camera("", pose).with_margin(margin), settings)
        return undistortion.render(frame.cpu().numpy(), margin)

    def degraded(
        self, lens: Lens, pose: Pose, medium: Medium, name: str, formation: Formation = Formation()
    ) -> NDArray[np.float32]:
        """[3, H, W] sRGB: what the camera would file of the twin through the medium, and the other effects."""
        psf = medium.psf_for(name)
        undistortion = _undistortion(lens)
        margin = undistortion.overscan + _SPLINE
        reach = 0 if psf is None or psf.is_identity else max(psf.radius)
        reach = max(reach, math.ceil(_REACH_SIGMAS * formation.reach(lens.width, lens.height)))
        camera = undistortion.camera("", pose).with_margin(margin)
        settings = RasterSettings(low_pass=self._low_pass, depth=formation.by_depth)
        rendered = self._rendered(camera.with_margin(reach), settings)
        frame = rendered.image
        blur = BlurOperator(psf, camera.height, camera.width, reach, frame.device, frame.dtype)
        shot = Shot(name, lens.height, lens.width, margin + reach, (lens.cx, lens.cy), rendered.mean_depth)
        return undistortion.render(formation.degrade(frame, blur.apply, medium, shot).cpu().numpy(), margin)

    def _pinhole(self, camera: Camera, settings: RasterSettings) -> Tensor:
        return self._rendered(camera, settings).image

    def _rendered(self, camera: Camera, settings: RasterSettings) -> Rendered:
        with torch.no_grad():
            unit = self._scale.camera_to_unit(camera)
            return render(self._gaussians, unit, background=self._background, settings=settings)


def to_pixels(planes: NDArray[np.float32]) -> NDArray[np.uint8]:
    """[3, H, W] in [0, 1] -> [H, W, 3] uint8, rounded."""
    values = np.round(np.clip(planes, 0.0, 1.0) * 255.0).astype(np.uint8)
    return np.ascontiguousarray(values.transpose(1, 2, 0))


@lru_cache(maxsize=4)
def _undistortion(lens: Lens) -> Undistortion:
    """Photos of one set share their lens, and its maps take longer than a render."""
    return Undistortion(lens)
