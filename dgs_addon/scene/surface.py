"""A twin's surface as a mesh object beside it, with its colours and each corner's standard deviation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from ...core.errors import FormatError
from .graph import new_material
from .measures import from_file

#: Object property that marks a twin's surface.
SURFACE = "dgs_surface"
_MATERIAL = "Descatter Surface"


def add_surface(twin: Any, path: Path, scene: Any) -> Any:
    """Puts a mesh that the engine has made of a twin where the twin stands, in place of the one before.

    Args:
        path: a PLY in the axes of the twin's file.

    Returns:
        The `bpy` object, a child of the twin.

    Raises:
        FormatError: Blender cannot read it, or the twin is of several files.
    """
    world = Matrix(from_file(twin).tolist())
    selected, active = list(bpy.context.selected_objects), bpy.context.view_layer.objects.active
    try:
        bpy.ops.wm.ply_import(filepath=str(path))
    except RuntimeError as error:
        raise FormatError(f"Blender cannot read the mesh ({error})", "Make it again") from error
    thing = bpy.context.view_layer.objects.active
    if thing is None or thing == active or thing.type != "MESH":
        raise FormatError("Blender cannot read the mesh", "Make it again")
    for other in [child for child in twin.children if child.get(SURFACE)]:
        bpy.data.objects.remove(other)
    thing.name = thing.data.name = f"{twin.name} surface"
    thing[SURFACE] = True
    _move_to(thing, twin, scene)
    thing.parent = twin
    thing.matrix_parent_inverse = twin.matrix_world.inverted()
    thing.matrix_basis = world
    thing.data.shade_smooth()
    colour = next(iter(thing.data.color_attributes), None)
    thing.data.materials.clear()
    thing.data.materials.append(_material(colour.name if colour is not None else ""))
    for other in bpy.context.view_layer.objects.selected[:]:
        other.select_set(False)
    for other in selected:
        other.select_set(True)
    bpy.context.view_layer.objects.active = active
    return thing


def _move_to(thing: Any, twin: Any, scene: Any) -> None:
    """Into the collection that the twin is in."""
    wanted = twin.users_collection[0] if twin.users_collection else scene.collection
    for collection in list(thing.users_collection):
        collection.objects.unlink(thing)
    wanted.objects.link(thing)


def _material(colours: str) -> Any:
    """Lit as matter is, in the colours of the corners."""
    existing = bpy.data.materials.get(_MATERIAL)
    if existing is not None:
        return existing
    material, graph = new_material(_MATERIAL)
    shader = graph.node("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.9
    if colours:
        graph.plug(shader.inputs["Base Color"], graph.node("ShaderNodeVertexColor", layer_name=colours).outputs[0])
    graph.node("ShaderNodeOutputMaterial", shader.outputs[0])
    return material
