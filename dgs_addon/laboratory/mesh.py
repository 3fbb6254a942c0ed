"""The scene 'mesh': somebody's own object on the laboratory's table, under its lights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import FormatError
from . import ball, table
from .materials import from_vertices, plain
from .settings import OBJECT_INDEX

#: Longest side (m) that an object is scaled to: the ball's, so that all camera paths fit.
LONGEST_SIDE = 0.28
#: What Blender reads, and with which operator.
_READERS = {
    ".obj": ("wm", "obj_import"),
    ".ply": ("wm", "ply_import"),
    ".stl": ("wm", "stl_import"),
    ".usd": ("wm", "usd_import"),
    ".usda": ("wm", "usd_import"),
    ".usdc": ("wm", "usd_import"),
    ".usdz": ("wm", "usd_import"),
    ".gltf": ("import_scene", "gltf"),
    ".glb": ("import_scene", "gltf"),
    # Blender's own reader where there is one (4.5 on): the older add-on stumbles over lamps in 5.0.
    ".fbx": ("wm", "fbx_import") if "fbx_import" in dir(bpy.ops.wm) else ("import_scene", "fbx"),
}
EXTENSIONS = tuple(_READERS)
#: Colour of an object without a material, linear Rec. 709.
_CLAY = (0.46, 0.36, 0.28)


def build(path: Path, seed: int, alone: bool = False) -> None:
    """Empties Blender's file and puts the object of `path` on the table: z = 0 below it, upright as it came.

    alone: the table is left out.

    Raises:
        FormatError: Blender reads no mesh from it.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    meshes = _imported(path)
    _settle(meshes)
    for item in meshes:
        item.pass_index = OBJECT_INDEX
        if not any(slot.material for slot in item.material_slots):
            colours = item.data.color_attributes
            item.data.materials.append(from_vertices(colours[0].name) if len(colours) else plain("clay", _CLAY))
    if not alone:
        table.build(scene, seed)
    ball.add_lights(scene)
    ball.add_camera(scene)


def _imported(path: Path) -> list[Any]:
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(f"'{path}' is no mesh that Blender reads", f"Give one of {', '.join(EXTENSIONS)}")
    module, name = reader
    try:
        getattr(getattr(bpy.ops, module), name)(filepath=str(path.resolve()))
    except (RuntimeError, AttributeError, OSError) as error:
        raise FormatError(f"Blender cannot read '{path}': {error}", "Export it again, or use another format") from error
    objects = list(bpy.context.scene.objects)
    meshes = [item for item in objects if item.type == "MESH" and len(item.data.polygons)]
    if not meshes:
        raise FormatError(f"'{path}' holds no mesh with faces", "Export the object with its faces")
    bpy.context.view_layer.update()
    for item in meshes:  # lights, cameras and empties of the file go; what hung on them stays where it is
        place = item.matrix_world.copy()
        item.parent = None
        item.animation_data_clear()
        item.matrix_world = place
    for item in objects:
        if item not in meshes:
            bpy.data.objects.remove(item, do_unlink=True)
    bpy.context.view_layer.update()
    return meshes


def _settle(meshes: list[Any]) -> None:
    """Scales all parts to the longest side, centres them and stands them on the table."""
    low, high = bounds(meshes)
    longest = float((high - low).max())
    if not longest > 0:
        raise FormatError("The mesh has no extent", "Export it again")
    share = LONGEST_SIDE / longest
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    move = np.eye(4)
    move[:3, :3] *= share
    move[:3, 3] = -share * middle
    for item in meshes:
        matrix = move @ np.array(item.matrix_world, dtype=np.float64)
        # Blender's matrices are assigned column by column from a nested sequence.
        item.matrix_world = matrix.T.tolist()
    bpy.context.view_layer.update()


def bounds(objects: list[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner ([3] each) of the objects' boxes in Blender's world."""
    corners = []
    for item in objects:
        matrix = np.array(item.matrix_world, dtype=np.float64)
        corners.append(np.array(item.bound_box, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
    joined = np.concatenate(corners)
    return joined.min(axis=0), joined.max(axis=0)
