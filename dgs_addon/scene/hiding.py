"""Hidden splats: Edit Mode's own Hide and Reveal, wherever splats are shown.

Blender marks hidden points for Edit Mode alone, and nodes may not read the mark. So a copy of it, that they may read,
follows it: when Edit Mode is left, and after an undo.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .nodes import HIDDEN
from .reading import read_flags
from .twin import is_twin


def hide(mesh: Any, hidden: NDArray[np.bool_]) -> None:
    """Hides these [N] of a mesh's points and shows all others; the mesh is not being edited."""
    mesh.vertices.foreach_set("hide", np.ascontiguousarray(hidden))
    copy_mark(mesh)


def copy_mark(mesh: Any) -> bool:
    """Brings the copy up to date; True if it was not. The mesh is not being edited."""
    hidden = read_flags(mesh, "hide")
    attribute = mesh.attributes.get(HIDDEN)
    if attribute is None:
        if not hidden.any():
            return False
        attribute = mesh.attributes.new(HIDDEN, "BOOLEAN", "POINT")
    before = np.empty(len(hidden), np.bool_)
    attribute.data.foreach_get("value", before)
    if np.array_equal(before, hidden):
        return False
    attribute.data.foreach_set("value", hidden)
    mesh.update()
    return True


@bpy.app.handlers.persistent
def follow(_scene: Any, depsgraph: Any) -> None:
    """Copies the mark of every twin that has changed."""
    for update in depsgraph.updates:
        if update.is_updated_geometry and isinstance(update.id, bpy.types.Object):
            twin = update.id.original
            if is_twin(twin) and not twin.data.is_editmode and twin.data.library is None:
                copy_mark(twin.data)
