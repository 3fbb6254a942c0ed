"""A twin's Gaussians and the cameras that it was trained on, read without its photos."""

from __future__ import annotations

from pathlib import Path

from ..camera import Camera
from ..errors import FormatError
from ..formats.cameras import read_cameras
from ..formats.ply import read_ply
from ..gaussians import Gaussians
from ..photos.undistort import Undistortion
from .folder import TwinFolder


def splats_and_cameras(folder: Path) -> tuple[Gaussians, list[Camera]]:
    """Gaussians and pinhole cameras of the photos that were not held out (of all, if those are none), by name.

    Raises:
        FormatError: no twin folder, or damaged.
    """
    kept = TwinFolder(folder)
    report = kept.report()
    gaussians = Gaussians.from_cloud(read_ply(kept.twin_file))
    if not kept.camera_folder.is_dir():
        raise FormatError(f"'{folder}' is no whole twin folder: it lacks cameras/", "Reconstruct the twin again")
    model = read_cameras(kept.camera_folder)
    cameras = [Undistortion(model.lenses[name]).camera(name, model.poses[name]) for name in sorted(model.poses)]
    shown = report.get("heldout")
    held = shown.get("names") if isinstance(shown, dict) else None
    left_out = set(held) if isinstance(held, list) and all(isinstance(name, str) for name in held) else set()
    return gaussians, [camera for camera in cameras if camera.name not in left_out] or cameras
