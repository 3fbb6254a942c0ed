"""Points with colours from PLY files, as nerfstudio and BlenderNeRF put them beside a transforms.json."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyParseError

from ..errors import FormatError
from ..views import SparsePoints

_PLACE, _COLOUR = ("x", "y", "z"), ("red", "green", "blue")
#: Of points without colours.
_GREY = 128


def read_ply_points(path: Path) -> SparsePoints:
    """The vertices of a PLY: x, y, z, and red, green, blue in 0..255 where it has them.

    Raises:
        FormatError: it is no PLY, lacks x, y or z, or a place is not finite.
    """
    try:
        vertices = PlyData.read(str(path), mmap=False)["vertex"].data
        positions = np.stack([np.asarray(vertices[name], np.float64) for name in _PLACE], axis=1)
        coloured = set(_COLOUR) <= set(vertices.dtype.names or ())
        grey = np.full((len(positions), 3), _GREY, np.uint8)
        colours = np.stack([np.asarray(vertices[name]) for name in _COLOUR], axis=1) if coloured else grey
        if colours.dtype.kind == "f":
            colours = np.clip(np.nan_to_num(colours), 0, 255)
    except (OSError, ValueError, TypeError, KeyError, IndexError, MemoryError, OverflowError, PlyParseError) as error:
        raise FormatError(
            f"The points in '{path}' cannot be read ({' '.join(str(error).split())})", "Export them again"
        ) from error
    if not np.isfinite(positions).all():
        wrong = int((~np.isfinite(positions).all(axis=1)).sum())
        raise FormatError(f"{wrong} points in '{path}' are not finite", "Export them again")
    return SparsePoints(positions, colours.astype(np.uint8))
