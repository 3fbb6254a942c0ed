"""A twin in memory: its Gaussians as arrays, its cameras, and pictures of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.background import parse_colour
from ..core.camera import Camera
from ..core.cloud import GaussianCloud
from ..core.devices import BackendName, choose_device
from ..core.errors import CameraError
from ..core.formats.cameras import CameraModel, read_cameras
from ..core.formats.gaussians import read_gaussians, write_gaussians
from ..core.gaussians import Gaussians
from ..core.imaging.medium import Medium
from ..core.imaging.psf_text import parse_psf
from ..core.lens import Lens
from ..core.photos.undistort import Undistortion
from ..core.pipeline.views import Viewer
from ..core.pose import Pose
from ..core.training.scale import twin_scale
from ..core.twin.folder import TwinFolder


@dataclass(frozen=True)
class Twin:
    """Gaussians, and the cameras of the photos that they were fitted to.

    Attributes:
        gaussians: raw, as 3DGS files have them: means [N, 3], log_scales [N, 3], quaternions [N, 4] (w x y z),
            opacity_logits [N], sh [N, K, 3]; float32.
        lenses, poses: of the photos, by name; world to camera, x right, y down, z forward. None in a twin from a file
            without cameras.
        report: what report.json says; empty where there is none.
    """

    gaussians: GaussianCloud
    lenses: dict[str, Lens] = field(default_factory=dict, repr=False)
    poses: dict[str, Pose] = field(default_factory=dict, repr=False)
    report: dict[str, Any] = field(default_factory=dict, repr=False)

    @staticmethod
    def open(path: Path | str, cameras: Path | str | None = None) -> Twin:
        """Reads a folder that a run left, or a file of Gaussians (PLY, SPZ, glTF, .splat).

        Args:
            cameras: a COLMAP model or transforms.json; those in the folder if not given.

        Raises:
            FormatError: nothing there that can be read.
        """
        place = Path(path)
        if not place.is_dir():
            model = None if cameras is None else read_cameras(Path(cameras))
            return _twin(read_gaussians(place), model, {})
        folder = TwinFolder(place)
        where = folder.camera_folder if cameras is None else Path(cameras)
        found = folder.report() if (place / "report.json").is_file() else {}
        model = read_cameras(where) if cameras is not None or where.is_dir() else None
        return _twin(read_gaussians(folder.twin_file), model, found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photos with a camera, sorted."""
        return tuple(sorted(self.poses))

    def __len__(self) -> int:
        return len(self.gaussians)

    def save(self, path: Path | str) -> None:
        """Writes the Gaussians in the format that the suffix names; raises OutputError, FormatError."""
        write_gaussians(Path(path), self.gaussians)

    def render(
        self,
        camera: str | Camera,
        psf: str = "none",
        background: str = "black",
        blur_space: str = "srgb",
        device: BackendName = "auto",
    ) -> NDArray[np.float32]:
        """A picture of the twin: see `render`."""
        return render(self, camera, psf, background, blur_space, device)


def _twin(cloud: GaussianCloud, model: CameraModel | None, report: dict[str, Any]) -> Twin:
    lenses, poses = ({}, {}) if model is None else (model.lenses, model.poses)
    return Twin(cloud, lenses, poses, report)


def render(
    twin: Twin,
    camera: str | Camera,
    psf: str = "none",
    background: str = "black",
    blur_space: str = "srgb",
    device: BackendName = "auto",
) -> NDArray[np.float32]:
    """A picture of a twin, sharp or through a medium.

    Args:
        camera: a photo's name, seen with its own lens; or any pinhole camera in the twin's world.
        psf: as `--psf` takes it, in px of the picture.
        background: behind the twin: white, black or '#rrggbb'.
        blur_space: the values that the blur acts on, 'srgb' or 'linear'.
        device: that computes it.

    Returns:
        [H, W, 3] float32, sRGB-encoded, in [0, 1] but for what a blur or bright harmonics overshoot.

    Raises:
        CameraError: no photo of this name has a camera. PsfError, DeviceError: the words make no sense.
    """
    if isinstance(camera, Camera):
        params = (camera.fx, camera.fy, camera.cx, camera.cy)
        lens, pose = Lens("PINHOLE", camera.width, camera.height, params), Pose(camera.rotation, camera.translation)
        name = camera.name
    elif camera in twin.poses:
        name, lens, pose = camera, twin.lenses[camera], twin.poses[camera]
    else:
        raise CameraError(f"No photo '{camera}' of this twin has a camera", "Choose one of its names")
    placed = [Undistortion(twin.lenses[one]).camera(one, twin.poses[one]) for one in twin.names]
    scale = twin_scale(placed or [Undistortion(lens).camera(name, pose)], twin.gaussians.means)
    medium = Medium(parse_psf(psf), "linear" if blur_space == "linear" else "srgb")
    behind = parse_colour(background)
    viewer = Viewer(Gaussians.from_cloud(twin.gaussians), scale, choose_device(device), background=behind)
    return np.ascontiguousarray(viewer.degraded(lens, pose, medium, name).transpose(1, 2, 0))
