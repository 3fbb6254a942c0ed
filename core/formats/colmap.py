"""COLMAP camera models, text and binary: read with numpy alone, written through pycolmap.

pycolmap ends the whole process when it is loaded into some builds of Blender, and goes on reading for minutes, or for
ever, in some files that were cut off. What we need of a model is little: lenses, poses and points.
Format: COLMAP's documentation, "Output Format".
"""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..conventions import rotation_from_quaternion
from ..errors import FormatError, OutputError
from ..files import sync_file, sync_folder
from ..lens import MODELS, Lens
from ..names import inner_name
from ..npy import read_npy
from ..pose import Pose
from ..views import SparsePoints
from .spec import CameraFormatSpec

#: Where a model may lie below the folder that the user names.
_FOLDERS = (".", "sparse/0", "sparse", "0", "cameras", "colmap/sparse/0")
#: A model's files, any of which may be named in place of their folder.
_FILES = ("cameras", "images", "points3D", "rigs", "frames")
_SUFFIXES = (".bin", ".txt")
#: Beside a model whose points are dense samples of surfaces: how sure each is, [M] in (0, 1] (`SparsePoints`).
CONFIDENCE = "confidence.npy"
#: Lens models by their number in binary files; None where `Lens` has no such model.
_NUMBERS = (
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    None,
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
)


def model_folder(path: Path) -> Path | None:
    """The folder at or below `path` that holds a COLMAP model, or None."""
    for below in _FOLDERS:
        folder = path / below
        for suffix in _SUFFIXES:
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
    lenses, poses = read_colmap_cameras(path)
    if not poses:
        raise FormatError(f"The COLMAP model in '{model_folder(path)}' places no image", "Choose another model")
    return lenses, poses, read_colmap_points(path)


def read_colmap_cameras(path: Path) -> tuple[dict[str, Lens], dict[str, Pose]]:
    """Lenses and poses by image name; points and observations are passed over.

    Args:
        path: folder with cameras and images (.bin or .txt), or one above ('sparse/0', 'cameras', ...).

    Raises:
        FormatError: no model there, or a damaged one.
    """
    folder = model_folder(path)
    if folder is None:
        raise FormatError(
            f"'{path}' holds no COLMAP model", "Name the folder with cameras.bin and images.bin (or .txt)"
        )
    try:
        if (folder / "cameras.bin").is_file():
            lenses = _binary_lenses((folder / "cameras.bin").read_bytes())
            images = _binary_images((folder / "images.bin").read_bytes())
        else:
            lenses = _text_lenses((folder / "cameras.txt").read_text(encoding="utf-8"))
            images = _text_images((folder / "images.txt").read_text(encoding="utf-8"))
        return {name: lenses[camera] for name, (camera, _) in images.items()}, {
            name: pose for name, (_, pose) in images.items()
        }
    except FormatError:
        raise
    except (OSError, struct.error, ValueError, IndexError, KeyError) as error:
        raise FormatError(
            f"The COLMAP model in '{folder}' is damaged ({type(error).__name__}: {error})", "Export it again"
        ) from error


def read_colmap_points(path: Path) -> SparsePoints:
    """The model's points; none where it has no file of them.

    Args:
        path: as for `read_colmap_cameras`.

    Raises:
        FormatError: no model there, or damaged points.
    """
    folder = model_folder(path)
    if folder is None:
        raise FormatError(f"'{path}' holds no COLMAP model", "Name the folder with cameras.bin and points3D.bin")
    try:
        if (folder / "points3D.bin").is_file():
            rows = _binary_points((folder / "points3D.bin").read_bytes())
        elif (folder / "points3D.txt").is_file():
            rows = _text_points((folder / "points3D.txt").read_text(encoding="utf-8"))
        else:
            rows = []
        values = np.array(rows, np.float64).reshape(-1, 9)
    except (OSError, struct.error, ValueError, IndexError) as error:
        raise FormatError(
            f"The points in '{folder}' are damaged ({type(error).__name__}: {error})", "Export them again"
        ) from error
    finite = np.isfinite(values[:, :7]).all(axis=1)
    if not finite.all():
        raise FormatError(f"{int((~finite).sum())} points in '{folder}' are not finite", "Export them again")
    values = values[np.argsort(values[:, 0], kind="stable")]  # by their number, in whichever order they were written
    confidence, error_px = _confidence(folder, len(values)), _mean_error(values[:, 7], values[:, 8])
    return SparsePoints(values[:, 1:4].copy(), values[:, 4:7].astype(np.uint8), confidence, error_px=error_px)


def _mean_error(errors: NDArray[np.float64], seen: NDArray[np.float64]) -> float:
    """Mean reprojection error (px) of points [M], each as often as it was seen; NaN where the model keeps none.

    COLMAP writes -1 for an error that it has not computed; what programs write for points without tracks is none.
    """
    known = np.isfinite(errors) & (errors >= 0) & (seen > 0)
    return float(np.average(errors[known], weights=seen[known])) if known.any() else float("nan")


def _confidence(folder: Path, count: int) -> NDArray[np.float32] | None:
    """What `write_lenses` left beside a model of dense points; None where it is not there, or not of these points."""
    path = folder / CONFIDENCE
    try:
        with path.open("rb") as file:
            values = read_npy(file, path.stat().st_size, "f")
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise FormatError(
            f"'{path}' is damaged ({error})", "Remove it: the points count as sparse ones then"
        ) from error
    fits = values.shape == (count,) and bool(((values > 0) & (values <= 1)).all())
    return values.astype(np.float32) if fits else None


def write_model(path: Path, cameras: Mapping[str, Camera], points: SparsePoints, binary: bool = True) -> None:
    """Writes pinhole cameras and points; see `write_lenses`."""
    lenses = {name: Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy)) for name, c in cameras.items()}
    write_lenses(path, lenses, {n: Pose(c.rotation, c.translation) for n, c in cameras.items()}, points, binary)


def write_lenses(
    path: Path, lenses: Mapping[str, Lens], poses: Mapping[str, Pose], points: SparsePoints, binary: bool = True
) -> None:
    """Writes cameras with their distortion, and points, as every COLMAP reader takes them.

    Each file is written beside and renamed.

    Args:
        path: folder, created if missing.
        lenses, poses: by image name; equal lenses are shared.
        points: written without tracks (the photos' observations are not kept); of dense ones the confidence stands in
            a file of ours beside the model.
        binary: .bin files, else .txt.

    Raises:
        OutputError: the folder cannot be written.
    """
    from ..colmap_library import pycolmap  # heavy; and Blender's Python lacks it

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
    way_out = "Free some space on that disk or choose another folder"
    beside = path / f".model.{os.getpid()}.part"  # (on the same disk)
    try:
        path.mkdir(parents=True, exist_ok=True)
        beside.mkdir(exist_ok=True)
        (model.write_binary if binary else model.write_text)(str(beside))
        if points.confidence is not None:
            np.save(beside / CONFIDENCE, points.confidence.astype(np.float32), allow_pickle=False)
        if binary and (cut_off := _cut_off(beside, {name: lenses[name] for name in poses}, len(points.positions))):
            raise OutputError(f"'{path / cut_off}' could not be written whole", way_out)
        # First: points that are replaced never stand beside a confidence of others.
        (path / CONFIDENCE).unlink(missing_ok=True)
        for file in sorted(beside.iterdir(), key=lambda file: file.name == CONFIDENCE):
            sync_file(file)
            os.replace(file, path / file.name)
        sync_folder(path)
    except (OSError, RuntimeError, ValueError) as error:  # (pycolmap's own for a full disk is a ValueError)
        raise OutputError(f"The camera model cannot be written into '{path}' ({error})", way_out) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _cut_off(folder: Path, lenses: Mapping[str, Lens], points: int) -> str | None:
    """Which of a binary model's files is shorter than it must be: pycolmap does not notice that a disk is full."""
    shared = set(lenses.values())
    sizes = {
        "cameras.bin": sum(24 + 8 * len(lens.params) for lens in shared),
        "images.bin": sum(73 + len(name.encode("utf-8")) for name in lenses),
        "points3D.bin": 51 * points,
        "rigs.bin": 16 * len(shared),
        "frames.bin": 84 * len(lenses),
    }
    return next((name for name, size in sizes.items() if (folder / name).stat().st_size < 8 + size), None)


def _binary_points(data: bytes) -> list[tuple[float, ...]]:
    """Rows of number x y z r g b, the mean reprojection error, and in how many photos it was seen."""
    (count,) = struct.unpack_from("<Q", data)
    rows, at = [], 8
    for _ in range(count):
        *row, track = struct.unpack_from("<Q3d3BdQ", data, at)
        rows.append((*row, float(track)))
        at = _inside(data, at + 51 + 8 * track)
    return rows


def _inside(data: bytes, at: int) -> int:
    if at > len(data):
        raise ValueError("cut off")
    return at


def _text_points(text: str) -> list[tuple[float, ...]]:
    lines = (line.split() for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return [(*map(float, [*line, "-1"][:8]), len(line[8:]) / 2) for line in lines]


def _pose(values: tuple[float, ...]) -> Pose:
    if not np.isfinite(values).all():
        raise ValueError("a pose that is not finite")
    rotation = rotation_from_quaternion(np.array(values[:4]))
    if not np.isfinite(rotation).all():
        raise ValueError("a rotation that is none")
    return Pose(rotation, np.array(values[4:7], float))


def _binary_lenses(data: bytes) -> dict[int, Lens]:
    (count,) = struct.unpack_from("<Q", data)
    lenses, at = {}, 8
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<iiQQ", data, at)
        name = _NUMBERS[model] if 0 <= model < len(_NUMBERS) else None
        if name is None:
            raise FormatError(f"The lens model {model} is not supported", f"Use one of {', '.join(MODELS)}")
        simple, distortion = MODELS[name]
        size = (3 if simple else 4) + distortion
        lenses[number] = Lens(name, width, height, struct.unpack_from(f"<{size}d", data, at + 24))
        at += 24 + 8 * size
    return lenses


def _binary_images(data: bytes) -> dict[str, tuple[int, Pose]]:
    (count,) = struct.unpack_from("<Q", data)
    images, at = dict[str, tuple[int, Pose]](), 8
    for _ in range(count):
        pose = _pose(struct.unpack_from("<7d", data, at + 4))
        (camera,) = struct.unpack_from("<i", data, at + 60)
        end = data.index(b"\0", at + 64)
        _add(images, data[at + 64 : end].decode("utf-8"), camera, pose)
        (observations,) = struct.unpack_from("<Q", data, end + 1)
        at = _inside(data, end + 9 + 24 * observations)
    return images


def _add(images: dict[str, tuple[int, Pose]], name: str, camera: int, pose: Pose) -> None:
    """Keeps an image by its name, which never leads out of the folder that it is put into."""
    inner = inner_name(name)
    if inner in images:
        raise ValueError(f"two images '{inner}'")
    images[inner] = camera, pose


def _text_lenses(text: str) -> dict[int, Lens]:
    lenses = {}
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            number, model, width, height, *params = line.split()
            lenses[int(number)] = Lens(model, int(width), int(height), tuple(map(float, params)))
    return lenses


def _text_images(text: str) -> dict[str, tuple[int, Pose]]:
    # Two lines per image; the second, of observations, may be empty.
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    first = next((index for index, line in enumerate(lines) if line.strip()), len(lines))
    images: dict[str, tuple[int, Pose]] = {}
    for line in lines[first::2]:
        if line.strip():
            _, *values = line.split(maxsplit=9)
            _add(images, values[8], int(values[7]), _pose(tuple(map(float, values[:7]))))
    return images


def _find(path: Path) -> Path | None:
    of_a_model = path.is_file() and path.suffix.lower() in _SUFFIXES and path.stem in _FILES
    return model_folder(path.parent if of_a_model else path)


COLMAP = CameraFormatSpec(
    name="colmap",
    label="COLMAP model",
    suffixes=_SUFFIXES,
    find=_find,
    read=lambda folder, _sizes: read_colmap_cameras(folder),
    read_points=read_colmap_points,
)
