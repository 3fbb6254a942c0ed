"""COLMAP camera models, text and binary; written through pycolmap."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..camera import Camera
from ..errors import FormatError, OutputError
from ..lens import Lens
from ..pose import Pose
from ..views import SparsePoints

_FOLDERS = (".", "sparse/0", "sparse", "0", "cameras", "colmap/sparse/0")


def model_folder(path: Path) -> Path | None:
    """The folder at or below `path` that holds a COLMAP model, or None."""
    for below in _FOLDERS:
        folder = path / below
        for suffix in (".bin", ".txt"):
            if (folder / f"cameras{suffix}").is_file() and (folder / f"images{suffix}").is_file():
                return folder
    return None


def read_model(path: Path) -> tuple[dict[str, Lens], dict[str, Pose], SparsePoints]:
    """Lenses and poses by image name, and the points.

    Args:
        path: folder with cameras/images/points3D (.bin or .txt), or one above ('sparse/0', ...).

    Raises:
        FormatError: no model there, or a damaged one.
    """
    # (pycolmap goes on reading for ever, or for minutes, in some files that were cut off)
    from .colmap_numpy import read_cameras, read_points

    lenses, poses = read_cameras(path)
    if not poses:
        raise FormatError(f"The COLMAP model in '{model_folder(path)}' places no image", "Choose another model")
    return lenses, poses, read_points(path)


def write_model(path: Path, cameras: Mapping[str, Camera], points: SparsePoints, binary: bool = True) -> None:
    """Writes pinhole cameras and points; see `write_lenses`."""
    lenses = {name: Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy)) for name, c in cameras.items()}
    write_lenses(path, lenses, {n: Pose(c.rotation, c.translation) for n, c in cameras.items()}, points, binary)


def write_lenses(
    path: Path, lenses: Mapping[str, Lens], poses: Mapping[str, Pose], points: SparsePoints, binary: bool = True
) -> None:
    """Writes cameras with their distortion, and points, as every COLMAP reader takes them.

    Args:
        path: folder, created if missing.
        lenses, poses: by image name; equal lenses are shared.
        points: written without tracks (the photos' observations are not kept).
        binary: .bin files, else .txt.

    Raises:
        OutputError: the folder cannot be written.
    """
    import pycolmap

    model = pycolmap.Reconstruction()
    shared: dict[Lens, int] = {}
    for index, name in enumerate(sorted(poses), start=1):
        lens = lenses[name]
        if lens not in shared:
            shared[lens] = len(shared) + 1
            model.add_camera_with_trivial_rig(
                pycolmap.Camera(
                    model=lens.model,
                    width=lens.width,
                    height=lens.height,
                    params=list(lens.params),
                    camera_id=shared[lens],
                )
            )
        image = pycolmap.Image(name=name, keypoints=np.zeros((0, 2)), camera_id=shared[lens], image_id=index)
        pose = poses[name]
        rotation = pycolmap.Rotation3d(np.asarray(pose.rotation, float))
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, np.asarray(pose.translation, float)))
    for position, colour in zip(points.positions, points.colours, strict=True):
        model.add_point3D(position, pycolmap.Track(), colour)
    try:
        path.mkdir(parents=True, exist_ok=True)
        (model.write_binary if binary else model.write_text)(str(path))
    except (OSError, RuntimeError) as error:
        raise OutputError(
            f"The camera model cannot be written into '{path}' ({error})", "Free space or choose another folder"
        ) from error
