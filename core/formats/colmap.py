"""COLMAP camera models, text and binary, through pycolmap."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..camera import Camera
from ..errors import FormatError, OutputError
from ..lens import Lens
from ..sfm.reconstruction import Pose, from_pycolmap
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
    import pycolmap

    folder = model_folder(path)
    if folder is None:
        raise FormatError(
            f"'{path}' holds no COLMAP model", "Name the folder with cameras.bin and images.bin (or .txt)"
        )
    model = pycolmap.Reconstruction()
    try:
        model.read(str(folder))
        lenses, poses, points = from_pycolmap(model)
    except FormatError:
        raise
    except Exception as error:  # pycolmap raises ValueError, IndexError, RuntimeError, ...
        raise FormatError(
            f"The COLMAP model in '{folder}' is damaged ({str(error).splitlines()[0][:160] if str(error) else type(error).__name__})",
            "Export it again",
        ) from error
    if not poses:
        raise FormatError(f"The COLMAP model in '{folder}' places no image", "Choose another model")
    return lenses, poses, points


def write_model(path: Path, cameras: Mapping[str, Camera], points: SparsePoints, binary: bool = True) -> None:
    """Writes pinhole cameras and points, as every COLMAP reader takes them.

    Args:
        path: folder, created if missing.
        cameras: by image name; equal lenses are shared.
        points: written without tracks (the photos' observations are not kept).
        binary: .bin files, else .txt.

    Raises:
        OutputError: the folder cannot be written.
    """
    import pycolmap

    model = pycolmap.Reconstruction()
    lenses: dict[tuple[float, ...], int] = {}
    for index, name in enumerate(sorted(cameras), start=1):
        camera = cameras[name]
        key = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        if key not in lenses:
            lenses[key] = len(lenses) + 1
            lens = pycolmap.Camera(
                model="PINHOLE", width=camera.width, height=camera.height,
                params=[camera.fx, camera.fy, camera.cx, camera.cy], camera_id=lenses[key],
            )  # fmt: skip
            model.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(name=name, camera_id=lenses[key], image_id=index)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.asarray(camera.rotation)), np.asarray(camera.translation))
        model.add_image_with_trivial_frame(image, pose)
    for position, colour in zip(points.positions, points.colours, strict=True):
        model.add_point3D(position, pycolmap.Track(), colour)
    try:
        path.mkdir(parents=True, exist_ok=True)
        (model.write_binary if binary else model.write_text)(str(path))
    except (OSError, RuntimeError) as error:
        raise OutputError(f"The camera model cannot be written into '{path}' ({error})", "Free space or choose another folder") from error
