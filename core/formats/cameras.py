"""Files of cameras of any format: the table of formats, and reading what a path holds."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..camera import Camera
from ..errors import FormatError
from ..lens import Lens
from ..pose import Pose
from ..reconstruction import no_points
from ..views import SparsePoints
from .colmap import COLMAP
from .llff import LLFF
from .spec import CameraFormatSpec
from .transforms import TRANSFORMS

#: Every format. The first that finds itself in a folder is read.
CAMERA_FORMATS: tuple[CameraFormatSpec, ...] = (
    TRANSFORMS,  # first: it lies in the folder that is named, a COLMAP model may lie below
    COLMAP,
    LLFF,  # last: the model that it was made of has points, too
)


@dataclass(frozen=True)
class CameraModel:
    """Cameras as a file holds them.

    Attributes:
        spec: the file's format.
        place: the file or folder that they were read from.
        lenses, poses: by photo name as the file spells it; at least one pose, and a lens for each.
    """

    spec: CameraFormatSpec
    place: Path
    lenses: dict[str, Lens] = field(repr=False)
    poses: dict[str, Pose] = field(repr=False)

    def pinholes(self) -> dict[str, Camera]:
        """Pinhole cameras by photo name, sorted; distortion is left out."""
        return {name: _pinhole(name, self.lenses[name], self.poses[name]) for name in sorted(self.poses)}

    def points(self) -> SparsePoints:
        """The model's sparse points, read now; none where its format has none.

        Raises:
            FormatError: damaged points.
        """
        return no_points() if self.spec.read_points is None else self.spec.read_points(self.place)


def browsed_suffixes() -> tuple[str, ...]:
    """Suffixes of files that a file browser shows."""
    return tuple(suffix for spec in CAMERA_FORMATS for suffix in spec.suffixes)


def camera_labels() -> str:
    """All formats, for messages and menus: 'transforms.json, COLMAP model'."""
    return ", ".join(spec.label for spec in CAMERA_FORMATS)


def read_cameras(path: Path, sizes: Mapping[str, tuple[int, int]] | None = None) -> CameraModel:
    """Reads the cameras that a path holds, whatever their format.

    Args:
        path: a file of cameras, or a folder with one in it.
        sizes: (width, height) of the photos in px by lower-case stem, for files that do not say it.

    Raises:
        FormatError: nothing there, no format reads it, or it is damaged.
    """
    for spec in CAMERA_FORMATS:
        place = spec.find(path)
        if place is not None:
            lenses, poses = spec.read(place, sizes or {})
            if not poses:
                raise FormatError(f"'{path}' places no camera", "Choose another model")
            return CameraModel(spec, place, lenses, poses)
    if not path.exists():
        raise FormatError(f"There are no cameras at '{path}': it does not exist", "Check the path of the cameras")
    raise FormatError(f"'{path}' holds no cameras", f"Give one of these: {camera_labels()}")


def brings_points(path: Path) -> bool:
    """Whether cameras at a path come with points; not where nothing there can be read: whoever reads it will say so."""
    for spec in CAMERA_FORMATS:
        with contextlib.suppress(FormatError):
            place = spec.find(path)
            if place is not None:
                return spec.read_points is not None and len(spec.read_points(place).positions) > 0
    return False


def _pinhole(name: str, lens: Lens, pose: Pose) -> Camera:
    return Camera(name, lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, pose.rotation, pose.translation)
