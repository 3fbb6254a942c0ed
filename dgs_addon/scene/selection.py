"""What splats are selected by in Edit Mode, and selecting them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bmesh
import numpy as np
from numpy.typing import NDArray

from ...core.constants import SH_C0
from .known import KNOWN
from .reading import read_flags, read_integers, read_values, readable
from .sources import known_of
from .twin import BASE, OWN_BASE, ROW, SCALE

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Splats:
    """A twin's splats as they are edited, row by row.

    Attributes:
        places: [N, 3] centres in the twin's own axes.
        own_sizes, sizes: [N] the longest standard deviation of each, in the twin's own units and in the scene's.
        opacities: [N] 0 to 1.
        colours: [N, 3] sRGB without gloss, 0 to 1.
        errors: [N] expected error of the colour as a share of a guess's, 0 to 1; None where nobody has estimated it.
        selected, hidden: [N].
    """

    places: Floats
    own_sizes: Floats
    sizes: Floats
    opacities: Floats
    colours: Floats
    errors: Floats | None
    selected: Flags
    hidden: Flags

    def __len__(self) -> int:
        return len(self.places)


def read_splats(twin: Any) -> Splats:
    """A twin's splats, whether it is edited now or not."""
    matrix = np.array(twin.matrix_world, np.float64)[:3, :3]
    unit = np.float32(np.abs(np.linalg.det(matrix)) ** (1 / 3))
    with readable(twin) as mesh:
        base = read_values(mesh, OWN_BASE if OWN_BASE in mesh.attributes else BASE, "color", 4)
        known = read_values(mesh, KNOWN, "value", 1)[:, 0] if KNOWN in mesh.attributes else None
        if known is None and ROW in mesh.attributes:
            known = known_of(twin.data, read_integers(mesh, ROW))
        own_sizes = read_values(mesh, SCALE, "vector", 3).max(axis=1, initial=0.0)
        return Splats(
            places=read_values(mesh, "position", "vector", 3),
            own_sizes=own_sizes,
            sizes=own_sizes * unit,
            opacities=base[:, 3],
            colours=np.clip(base[:, :3] * np.float32(SH_C0) + np.float32(0.5), 0.0, 1.0),
            # The share of a colour's variance that is left open is 1 - known.
            errors=None if known is None else np.sqrt(1.0 - np.clip(known, 0.0, 1.0)),
            selected=read_flags(mesh, "select"),
            hidden=read_flags(mesh, "hide"),
        )


def select(twin: Any, selected: Flags) -> int:
    """Selects these splats and no others; hidden ones stay as they are.

    Args:
        twin: in Edit Mode; selected: [N], in the order of `read_splats`.

    Returns:
        How many are selected now.
    """
    points = bmesh.from_edit_mesh(twin.data)
    for point, on in zip(points.verts, selected.tolist(), strict=True):
        if not point.hide:
            point.select = on
    points.select_history.clear()
    bmesh.update_edit_mesh(twin.data, loop_triangles=False, destructive=False)
    return int(twin.data.total_vert_sel)
