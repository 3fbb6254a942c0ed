"""Renders a twin as a photo's own lens sees it, sharp or through the medium."""

from __future__ import annotations

import threading
from copy import copy
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from ..background import BLACK, WHITE, Colour
from ..camera import Camera
from ..compositing import transparent
from ..constants import LOW_PASS_VARIANCE
from ..forward import FixedMedium, ForwardModel, margin_for, medium_of, sharp_view, space_of
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.medium import BlurSpace, Medium
from ..imaging.psf import PointSpread
from ..lens import Lens
from ..photos.undistort import Undistortion
from ..pose import Pose
from ..rasterizer import RasterSettings
from ..training.scale import SceneScale

#: Pixels around a frame that interpolation at its border reads.
_SPLINE = 3


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
        self._kept: tuple[object, FixedMedium] | None = None
        self._making = threading.Lock()

    def sharp(self, lens: Lens, pose: Pose, finer: float = 1.0) -> NDArray[np.float32]:
        """[3, H, W] sRGB, with the lens's distortion.

        `finer` says how many times finer the lens's grid is than the one that `low_pass` is meant on.
        """
        settings = RasterSettings(low_pass=self._low_pass * finer**2)
        undistortion = _undistortion(lens)
        margin = undistortion.overscan + _SPLINE
        camera = self._scale.camera_to_unit(undistortion.camera("", pose).with_margin(margin))
        with torch.no_grad():
            frame = sharp_view(self._gaussians, camera, settings, self._background).image
        return undistortion.render(frame.cpu().numpy(), margin)

    def degraded(
        self, lens: Lens, pose: Pose, medium: Medium, name: str, formation: Formation = Formation()
    ) -> NDArray[np.float32]:
        """[3, H, W] sRGB: what the camera would file of the twin through the medium, and the other effects."""
        psf = medium.psf_for(name)
        undistortion = _undistortion(lens)
        overscan = undistortion.overscan + _SPLINE
        # As far as a point spread reaches; of what effects spread, as far as the training's frames do.
        reach = 0 if psf is None or psf.is_identity else max(psf.radius)
        reach = max(reach, margin_for(formation.reach(lens.width, lens.height)))
        camera = self._scale.camera_to_unit(undistortion.camera(name, pose))
        settings = RasterSettings(low_pass=self._low_pass, depth=formation.by_depth)
        frame = Frame(camera.height + 2 * overscan, camera.width + 2 * overscan, reach)
        behind = self._background
        made = self._medium(psf, frame, space_of(medium), psf is medium.psf)
        model = ForwardModel(settings, lambda _: made, reach, formation.scaled(1.0 / self._scale.size))
        with torch.no_grad():
            exposed = model.expose(self._gaussians, _Photo(name, camera, psf), behind, overscan)
        return undistortion.render(exposed.photo.cpu().numpy(), overscan)

    def _medium(self, psf: PointSpread | None, frame: Frame, space: BlurSpace, shared: bool) -> FixedMedium:
        """Of a photo; where all share their point spread that of the photo before, if it was of the same size.

        One is kept: frames are whole photos. Views that are rendered side by side wait for it, none makes its own.
        """
        behind = self._background
        if not shared or psf is None:
            return medium_of(psf, frame, space, behind.device, behind.dtype)
        key = frame, space, psf.kernel().tobytes()
        with self._making:
            if self._kept is None or self._kept[0] != key:
                self._kept = key, medium_of(psf, frame, space, behind.device, behind.dtype)
            return self._kept[1]

    def transparent(self, lens: Lens, pose: Pose, medium: Medium, name: str) -> NDArray[np.float32]:
        """[4, H, W] sRGB, not multiplied by alpha, and alpha: as `degraded`, with nothing behind the twin."""
        black, white = (self._over(colour).degraded(lens, pose, medium, name) for colour in (BLACK, WHITE))
        return transparent(black, white, space_of(medium))

    def _over(self, colour: Colour) -> Viewer:
        other = copy(self)
        other._background = torch.tensor(colour, device=self._background.device)
        return other


class _Photo(NamedTuple):
    """What `ForwardModel.expose` asks of a photo."""

    name: str
    camera: Camera
    psf: PointSpread | None


def to_pixels(planes: NDArray[np.float32]) -> NDArray[np.uint8]:
    """[C, H, W] in [0, 1] -> [H, W, C] uint8, rounded."""
    values = np.round(np.clip(planes, 0.0, 1.0) * 255.0).astype(np.uint8)
    return np.ascontiguousarray(values.transpose(1, 2, 0))


@lru_cache(maxsize=4)
def _undistortion(lens: Lens) -> Undistortion:
    """Photos of one set share their lens, and its maps take longer than a render."""
    return Undistortion(lens)
