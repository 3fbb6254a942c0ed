"""Brings back splats that were deleted, from the files that a twin came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud, cloud_part, finite_rows, joined
from ...core.errors import FormatError
from .known import KNOWN
from .reading import read_integers, read_values, readable
from .sources import known_of, read_sources
from .twin import BASE, OWN_BASE, ROW, TWIN, fields_of, splat_mesh


@dataclass(frozen=True)
class Missing:
    """Splats that a twin's files have and the twin has not.

    Attributes:
        rows: [M] of the twin's mesh (`twin.ROW`).
        cloud: [M] the splats, in the mesh's axes.
    """

    rows: NDArray[np.int32]
    cloud: GaussianCloud


def missing_splats(twin: Any) -> Missing:
    """What was deleted of a twin.

    Raises:
        FormatError: a file is gone or another one by now, or the twin does not say what it came from.
    """
    sources = read_sources(twin.data)
    with readable(twin) as mesh:
        if not sources or ROW not in mesh.attributes:
            raise FormatError(f"'{twin.name}' does not say which file it came from", "Import it again")
        there = read_integers(mesh, ROW)
    rows, clouds = [], []
    for source in sources:
        cloud = source.cloud()
        lost = np.setdiff1d(np.flatnonzero(finite_rows(cloud)), there - source.first)
        rows.append(lost + source.first)
        clouds.append(cloud_part(cloud, lost))
    return Missing(np.concatenate(rows).astype(np.int32), joined(clouds, int(twin[TWIN])))


def restore(twin: Any, missing: Missing) -> None:
    """Adds them behind the splats that are there.

    Args:
        twin: `bpy` object, not in Edit Mode; missing: at least one splat, of `missing_splats`.
    """
    mesh, added = twin.data, splat_mesh(missing.cloud, "restored")
    known = known_of(mesh, missing.rows)
    before = len(mesh.vertices)
    mesh.vertices.add(len(missing.rows))
    for name, field, width in fields_of(int(twin[TWIN])):
        _put(mesh, name, field, before, read_values(added, name, field, width))
    _put_integers(mesh, ROW, before, missing.rows)
    if OWN_BASE in mesh.attributes:
        _put(mesh, OWN_BASE, "color", before, read_values(added, BASE, "color", 4))
    if KNOWN in mesh.attributes and known is not None:
        _put(mesh, KNOWN, "value", before, known[:, None])
    bpy.data.meshes.remove(added)
    mesh.update()


def _put(mesh: Any, name: str, field: str, first: int, values: NDArray[np.float32]) -> None:
    """Writes the values of the points from the row `first` on."""
    whole = read_values(mesh, name, field, values.shape[1])
    whole[first:] = values
    mesh.attributes[name].data.foreach_set(field, whole.reshape(-1))


def _put_integers(mesh: Any, name: str, first: int, values: NDArray[np.int32]) -> None:
    whole = read_integers(mesh, name)
    whole[first:] = values
    mesh.attributes[name].data.foreach_set("value", whole)
