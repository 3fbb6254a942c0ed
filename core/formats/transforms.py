"""transforms.json of instant-ngp and nerfstudio: OpenGL camera axes, camera to world."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..conventions import from_opengl, to_opengl
from ..errors import FormatError
from ..files import read_json, write_text
from ..json_shape import check_shape, number, text
from ..lens import Lens
from ..names import inner_name
from ..pose import Pose
from ..reconstruction import no_points
from ..views import SparsePoints
from .point_clouds import read_ply_points
from .spec import CameraFormatSpec

_EXPORT = "Export it again, or give a COLMAP model"


def read_transforms(
    path: Path, sizes: Mapping[str, tuple[int, int]] | None = None
) -> tuple[dict[str, Lens], dict[str, Pose]]:
    """Lenses and poses by file name, as the file names them: without folders, but where two photos are called alike.

    Args:
        path: the JSON file, or a folder with a transforms.json.
        sizes: (width, height) by lower-case stem, for files that do not say the photos' size.

    Raises:
        FormatError: the file is missing, no JSON, lacks what it needs, or names a photo twice.
    """
    if path.is_dir():
        path = path / "transforms.json"
    try:
        content = read_json(path)
    except OSError as error:
        raise FormatError(f"'{path}' cannot be read ({error.strerror})", "Check the path of the cameras") from error
    except ValueError as error:
        raise FormatError(f"'{path}' is not JSON ({error})", _EXPORT) from error
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise FormatError(f"'{path}' lists no frames", _EXPORT)
    lenses: dict[str, Lens] = {}
    poses: dict[str, Pose] = {}
    for frame, name in zip(frames, _names(path, frames), strict=True):
        try:
            rotation, translation = from_opengl(np.array(frame["transform_matrix"], float))
            poses[name] = Pose(rotation, translation)
            lenses[name] = _lens({**content, **frame}, (sizes or {}).get(_stem(name)))
        except FormatError as error:
            raise FormatError(f"'{path}', frame '{name}': {error.what}", error.way_out) from error
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(f"'{path}' has a damaged frame ({type(error).__name__}: {error})", _EXPORT) from error
    return lenses, poses


def _names(path: Path, frames: list[Any]) -> list[str]:
    """What each frame's photo is called: its last name, with its folders only where another has the same."""
    try:
        for frame in frames:
            check_shape(frame, {"file_path": text, "transform_matrix": [[number]]})
        inner = [inner_name(frame["file_path"]) for frame in frames]
    except ValueError as error:
        raise FormatError(f"'{path}' has a damaged frame ({error})", _EXPORT) from error
    twice = next((name for name, count in Counter(inner).items() if count > 1), None)
    if twice is not None:
        raise FormatError(f"'{path}' has two frames of the photo '{twice}'", "Keep one of them")
    last = [name.rsplit("/", 1)[-1] for name in inner]
    count = Counter(last)
    return [short if count[short] == 1 else name for short, name in zip(last, inner, strict=True)]


def read_transforms_points(path: Path) -> SparsePoints:
    """The points of the PLY that `ply_file_path` names (nerfstudio, BlenderNeRF), in the world of the poses.

    Args:
        path: as for `read_transforms`.

    Returns:
        None at all where no PLY is named, or the one that is named is not there.

    Raises:
        FormatError: the PLY is damaged.
    """
    if path.is_dir():
        path = path / "transforms.json"
    try:
        content = read_json(path)
        named = content.get("ply_file_path") if isinstance(content, dict) else None
        file = path.parent / inner_name(named) if isinstance(named, str) and named else None
    except (OSError, ValueError):
        file = None  # what is wrong with the file itself, reading the cameras says
    if file is None or not file.is_file():
        return no_points()
    return read_ply_points(file)


def _stem(name: str) -> str:
    return name.rsplit("/", 1)[-1].rsplit(".", 1)[0].casefold()


def _lens(values: dict[str, Any], size: tuple[int, int] | None) -> Lens:
    if "w" in values and "h" in values:
        width, height = int(_number(values, "w")), int(_number(values, "h"))
    elif size is not None:
        width, height = size
    else:
        raise FormatError("The photos' size is missing (w, h)", _EXPORT)
    if "fl_x" in values:
        fx = _number(values, "fl_x")
    elif "camera_angle_x" in values:
        fx = _focal(width, values, "camera_angle_x")
    else:
        raise FormatError("The focal length is missing (fl_x or camera_angle_x)", _EXPORT)
    if "fl_y" in values:
        fy = _number(values, "fl_y")
    elif "camera_angle_y" in values:
        fy = _focal(height, values, "camera_angle_y")
    else:
        fy = fx
    head = (fx, fy, _number(values, "cx", width / 2), _number(values, "cy", height / 2))
    k = [_number(values, key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")]
    if "FISHEYE" in str(values.get("camera_model", "")).upper() or values.get("is_fisheye"):
        return Lens("OPENCV_FISHEYE", width, height, (*head, *k[:4]))
    if not any(k):
        return Lens("PINHOLE", width, height, head)
    if k[2] or k[3]:  # nerfstudio's k4 is OpenCV's first denominator coefficient in no version we know
        return Lens("FULL_OPENCV", width, height, (*head, k[0], k[1], k[4], k[5], k[2], 0.0, 0.0, 0.0))
    return Lens("OPENCV", width, height, (*head, k[0], k[1], k[4], k[5]))


def _number(values: dict[str, Any], key: str, missing: float = 0.0) -> float:
    value = float(values.get(key, missing))
    if not math.isfinite(value):
        raise ValueError(f"{key} is not finite")
    return value


def _focal(side: int, values: dict[str, Any], key: str) -> float:
    """px, from the angle (radians) that a side of the photo sees."""
    angle = _number(values, key)
    if not 0.0 < angle < math.pi:
        raise ValueError(f"{key} is no angle of view")
    return 0.5 * side / math.tan(0.5 * angle)


def write_transforms(path: Path, cameras: Mapping[str, Camera]) -> None:
    """Writes pinhole cameras; the keys of `cameras` become `file_path`.

    Raises:
        OutputError: the file cannot be written.
    """
    frames = [
        {
            "file_path": name,
            "w": camera.width,
            "h": camera.height,
            "fl_x": camera.fx,
            "fl_y": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "transform_matrix": to_opengl(camera.rotation, camera.translation).tolist(),
        }
        for name, camera in sorted(cameras.items())
    ]
    write_text(path, json.dumps({"camera_model": "PINHOLE", "frames": frames}, indent=1, ensure_ascii=False))


def _find(path: Path) -> Path | None:
    if path.suffix.lower() == ".json" and not path.is_dir():
        return path  # whether it is there or not: reading it says what is wrong
    return path / "transforms.json" if (path / "transforms.json").is_file() else None


TRANSFORMS = CameraFormatSpec(
    name="transforms.json",
    label="transforms.json",
    suffixes=(".json",),
    find=_find,
    read=read_transforms,
    read_points=read_transforms_points,
)
