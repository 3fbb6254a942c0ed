"""poses_bounds.npy of LLFF, as the data sets of Deblur-NeRF and of forward-facing scenes have it.

A row for each photo, sorted by name: [3, 5] and the nearest and farthest depth. Of the [3, 5] the first four columns
are the pose, camera to world, its axes pointing down, right and backwards; the last is height, width and focal length
in px. The file has no names: they are those of the photos in the folder `images` beside it, or of the photos at hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..conventions import from_llff
from ..errors import FormatError
from ..lens import Lens
from ..npy import load_npy
from ..pose import Pose
from .spec import CameraFormatSpec, LensesAndPoses

FILE = "poses_bounds.npy"
#: Folders of photos beside the file; the first that has as many as there are rows counts.
_IMAGES = ("images", "images_4", "images_8", ".")
#: Endings that such data sets use.
_SUFFIXES = frozenset({".png", ".jpg", ".jpeg"})
#: Numbers in a row: a [3, 5], and two depths.
_COLUMNS = 17


def read_llff(path: Path, sizes: Mapping[str, tuple[int, int]]) -> LensesAndPoses:
    """Lenses and poses by file name, or by stem where no folder of photos lies beside the file.

    Args:
        path: the file; sizes: (width, height) of the photos at hand by lower-case stem.

    Raises:
        FormatError: it is damaged, or has another number of rows than there are photos.
    """
    rows = _rows(path)
    lenses, poses = {}, {}
    for name, row in zip(_names(path, len(rows), sizes), rows, strict=True):
        matrix = row[:15].reshape(3, 5)
        height, width, focal = matrix[:, 4]
        try:
            poses[name] = Pose(*from_llff(matrix[:, :4]))
        except ValueError as error:
            raise FormatError(f"'{path}', photo '{name}': {error}", "Export it again") from error
        if not (1.0 <= width <= 1e6 and 1.0 <= height <= 1e6 and 0.0 < focal < 1e9):
            raise FormatError(f"'{path}', photo '{name}': no such lens", "Export it again")
        lenses[name] = Lens("SIMPLE_PINHOLE", round(width), round(height), (focal, width / 2, height / 2))
    return lenses, poses


def _rows(path: Path) -> NDArray[np.float64]:
    try:
        rows = load_npy(path)
    except (OSError, ValueError, EOFError) as error:
        raise FormatError(f"'{path}' cannot be read ({error})", "Export it again") from error
    if rows.ndim != 2 or rows.shape[1] != _COLUMNS or not len(rows) or not np.isfinite(rows).all():
        raise FormatError(f"'{path}' has no rows of {_COLUMNS} numbers", "Give LLFF's file, or a COLMAP model")
    return rows.astype(np.float64)


def _names(path: Path, count: int, sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    folders = [path.parent / name for name in _IMAGES if (path.parent / name).is_dir()]
    listed = [sorted(p.name for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES) for folder in folders]
    for names in (*listed, sorted(sizes)):
        if len(names) == count:
            return names
    there = ", ".join(str(len(names)) for names in (*listed, sizes) if names) or "none"
    raise FormatError(
        f"'{path}' has {count} rows, one for each photo, and there are {there}",
        "Put the photos that it was made for into 'images' beside it",
    )


def _find(path: Path) -> Path | None:
    if path.name == FILE:
        return path
    return path / FILE if (path / FILE).is_file() else None


LLFF = CameraFormatSpec("llff", FILE, suffixes=(".npy",), find=_find, read=read_llff, from_photos=True)
