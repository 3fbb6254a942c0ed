"""Reads a mesh's points in bulk, also while they are edited.

In Edit Mode Blender keeps a mesh elsewhere, and its attributes are empty: a copy of what is edited has them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray


@contextmanager
def readable(thing: Any) -> Iterator[Any]:
    """An object's `bpy` mesh with its attributes, as it is now; to be read only, and only inside the `with`."""
    if not thing.data.is_editmode:
        yield thing.data
        return
    thing.update_from_editmode()
    try:
        yield thing.to_mesh(preserve_all_data_layers=True)
    finally:
        thing.to_mesh_clear()


def read_values(mesh: Any, name: str, field: str, width: int) -> NDArray[np.float32]:
    """[N, width] an attribute of the points.

    Args:
        mesh: of `readable`; name: of the attribute; field: where its kind keeps the numbers.

    Raises:
        KeyError: the mesh has no such attribute.
    """
    array = np.empty(len(mesh.vertices) * width, np.float32)
    mesh.attributes[name].data.foreach_get(field, array)
    return array.reshape(-1, width)


def read_integers(mesh: Any, name: str) -> NDArray[np.int32]:
    """[N] a whole number a point; raises KeyError as `read_values`."""
    array = np.empty(len(mesh.vertices), np.int32)
    mesh.attributes[name].data.foreach_get("value", array)
    return array


def read_flags(mesh: Any, flag: str) -> NDArray[np.bool_]:
    """[N] a flag that Blender itself keeps of points: 'select' or 'hide'."""
    array = np.empty(len(mesh.vertices), np.bool_)
    mesh.vertices.foreach_get(flag, array)
    return array
