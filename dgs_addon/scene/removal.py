"""Takes out of a scene what this add-on put there, and nothing that anything else still uses."""

from __future__ import annotations

from typing import Any

import bpy


def take_out(thing: Any, collection: Any) -> None:
    """Takes an object out of a collection; it is removed where nothing but this collection had it.

    Its data go with it, unless other objects (such as linked duplicates) use them.
    """
    collection.objects.unlink(thing)
    if thing.users_collection or thing.use_fake_user:
        return
    data = thing.data
    bpy.data.objects.remove(thing)
    remove_unused(data)


def remove_unused(data: Any) -> None:
    """Removes a mesh or a camera's data if nothing uses it; None is nothing."""
    if data is not None and data.users == 0:
        bpy.data.batch_remove([data])


def replace_mesh(before: Any, mesh: Any) -> None:
    """Whatever shows the mesh `before` shows `mesh` from now on, linked duplicates included; it takes its name, too."""
    name = before.name
    before.user_remap(mesh)
    remove_unused(before)
    mesh.name = name
