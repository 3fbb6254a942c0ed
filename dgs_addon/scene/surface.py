"""A twin's surface as a mesh object beside it: with a texture, or with each corner's colour and standard deviation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from ...core.errors import FormatError
from .graph import new_material
from .measures import from_file
from .removal import remove_unused

#: Object property that marks a twin's surface.
SURFACE = "dgs_surface"
_MATERIAL, _TEXTURED = "Descatter Surface", "Descatter Textured Surface"
#: An OBJ's y points up and its z towards the viewer, the engine's the other way.
_FROM_OBJ = Matrix.Diagonal((1.0, -1.0, -1.0, 1.0))


def add_surface(twin: Any, path: Path, scene: Any) -> Any:
    """Puts a mesh that the engine has made of a twin where the twin stands, in place of the one before.

    Args:
        path: a PLY in the axes of the twin's file, or an OBJ with y up and the PNG of its texture beside it.

    Returns:
        The `bpy` object, a child of the twin.

    Raises:
        FormatError: Blender cannot read it, or the twin is of several files.
    """
    world, textured = Matrix(from_file(twin).tolist()), path.suffix == ".obj"
    selected, active = list(bpy.context.selected_objects), bpy.context.view_layer.objects.active
    try:
        if textured:
            bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z", use_split_objects=False)
        else:
            bpy.ops.wm.ply_import(filepath=str(path))
    except RuntimeError as error:
        raise FormatError(f"Blender cannot read the mesh ({error})", "Make it again") from error
    thing = bpy.context.view_layer.objects.active
    if thing is None or thing == active or thing.type != "MESH":
        raise FormatError("Blender cannot read the mesh", "Make it again")
    for other in [child for child in twin.children if child.get(SURFACE)]:
        before = other.data
        bpy.data.objects.remove(other)
        _remove_materials(before, None)
        remove_unused(before)
    thing.name = thing.data.name = f"{twin.name} surface"
    thing[SURFACE] = True
    _move_to(thing, twin, scene)
    thing.parent = twin
    thing.matrix_parent_inverse = twin.matrix_world.inverted()
    thing.matrix_basis = world @ _FROM_OBJ if textured else world
    thing.data.shade_smooth()
    _give_material(thing.data, _packed(path.with_suffix(".png")) if textured else None)
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


def _packed(path: Path) -> Any:
    """A picture that the .blend carries: the file is gone after this."""
    picture = bpy.data.images.load(str(path))
    picture.pack()
    return picture


def _give_material(mesh: Any, texture: Any) -> None:
    """Its own with a texture, else the one of all surfaces; what the importer made is gone."""
    _remove_materials(mesh, texture)
    colour = next(iter(mesh.color_attributes), None)
    mesh.materials.append(_material(colour.name if colour is not None else "", texture))


def _remove_materials(mesh: Any, kept: Any) -> None:
    """Takes a mesh's materials off it, and removes them with their pictures if nothing else uses them."""
    materials = [material for material in mesh.materials if material is not None]
    nodes = [node for material in materials for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    pictures = {node.image for node in nodes} - {kept, None}
    mesh.materials.clear()
    for unused in (*materials, *pictures):
        remove_unused(unused)


def _material(colours: str, texture: Any) -> Any:
    """Lit as matter is, in the colours of the corners or of a texture."""
    existing = bpy.data.materials.get(_MATERIAL)
    if existing is not None and texture is None:
        return existing
    material, graph = new_material(_MATERIAL if texture is None else _TEXTURED)
    shader = graph.node("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.9
    if texture is not None:
        graph.plug(shader.inputs["Base Color"], graph.node("ShaderNodeTexImage", image=texture).outputs[0])
    elif colours:
        graph.plug(shader.inputs["Base Color"], graph.node("ShaderNodeVertexColor", layer_name=colours).outputs[0])
    graph.node("ShaderNodeOutputMaterial", shader.outputs[0])
    return material
