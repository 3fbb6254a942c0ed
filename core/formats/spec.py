"""What a file format is: one object, from which reading, writing, menus, drops and messages are made.

A format is one file that ends with such an object, and one line in a table: `SPLAT_FORMATS` in `gaussians`, or
`CAMERA_FORMATS` in `cameras`. Nothing else lists formats. Blender reads the tables: they must not need torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..cloud import GaussianCloud
from ..lens import Lens
from ..pose import Pose
from ..views import SparsePoints

#: Lenses and poses by photo name.
LensesAndPoses = tuple[dict[str, Lens], dict[str, Pose]]


@dataclass(frozen=True)
class FormatSpec:
    """A format of files that hold Gaussians.

    Attributes:
        name: as people call it ('SPZ').
        suffixes: in lower case, with the dot; the first is the one that is written.
        holds: what a file keeps and what it loses, in a line for a menu, without a full stop.
        read: takes the file; raises FormatError where it cannot be used.
        write: takes the file and the Gaussians; raises OutputError where it cannot be written. None: read only.
        dropped: whether a file that is dropped on a 3D view is ours to open; not where Blender has an importer.
    """

    name: str
    suffixes: tuple[str, ...]
    holds: str
    read: Callable[[Path], GaussianCloud]
    write: Callable[[Path, GaussianCloud], None] | None
    dropped: bool = True


@dataclass(frozen=True)
class CameraFormatSpec:
    """A format of files that hold cameras.

    Attributes:
        name: as reports call it ('colmap').
        label: as menus and messages call it ('COLMAP model').
        suffixes: of the files that a file browser shows, with the dot.
        find: takes what the user gave, a file or a folder; returns the place that `read` takes, or None where
            nothing of this format is there. Goes by names only.
        read: takes that place, and the photos' (width, height) by lower-case stem for files that do not say the
            size; raises FormatError where they cannot be used.
        read_points: takes that place; None for a format that has no points.
        from_photos: whether such files come of structure from motion only, so that no cameras in them are exact.
    """

    name: str
    label: str
    suffixes: tuple[str, ...]
    find: Callable[[Path], Path | None]
    read: Callable[[Path, Mapping[str, tuple[int, int]]], LensesAndPoses]
    read_points: Callable[[Path], SparsePoints] | None = None
    from_photos: bool = False
