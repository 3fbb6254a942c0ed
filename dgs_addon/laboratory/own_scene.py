"""An existing .blend: its own objects, lights, world and materials; cameras on a path, or its animated one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import DgsError, FormatError
from ..axes import read_camera
from .ball import add_camera
from .mesh import bounds
from .settings import OBJECT_INDEX


def build(path: Path) -> None:
    """Opens the file without running scripts in it, with a camera of ours beside its own.

    Raises:
        FormatError: it is no .blend, or shows nothing.
    """
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise FormatError(
            f"Blender cannot open '{path}': {error}", "Give a .blend of this Blender or an older one"
        ) from error
    scene = bpy.context.scene
    meshes = _shown(scene)
    if not meshes:
        raise FormatError(f"The scene in '{path}' shows no mesh", "Check what is hidden from renders")
    scene.frame_set(scene.frame_start)
    scene.render.use_motion_blur = False
    scene.render.use_border = False
    if not any(item.pass_index == OBJECT_INDEX for item in meshes):  # then the object is all there is
        for item in meshes:
            item.pass_index = OBJECT_INDEX


def own_cameras(views: int, width: int, height: int, names: list[str]) -> list[Camera]:
    """The scene's own camera at `views` moments spread over its frames; what else moves is held at the first.

    Raises:
        DgsError: there is no perspective camera.
    """
    scene = bpy.context.scene
    camera = scene.camera
    if camera is None or camera.data.type != "PERSP":
        raise DgsError("The scene has no perspective camera", "Set one, or choose another --path")
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    found = []
    for moment, name in zip(np.linspace(scene.frame_start, scene.frame_end, views), names, strict=True):
        scene.frame_set(int(moment), subframe=float(moment % 1))
        found.append(read_camera(camera.evaluated_get(bpy.context.evaluated_depsgraph_get()), render, name))
    scene.frame_set(scene.frame_start)
    return found


def enter_camera() -> None:
    """Renders go through a camera of ours from now on: the scene's own may be animated or out of focus."""
    add_camera(bpy.context.scene)


def extent() -> tuple[NDArray[np.float64], float]:
    """[3] middle of the object (those of pass index 1, or all) in Blender's world, and its radius."""
    marked = [item for item in _shown(bpy.context.scene) if item.pass_index == OBJECT_INDEX]
    low, high = bounds(marked)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)


def _shown(scene: Any) -> list[Any]:
    return [item for item in scene.objects if item.type == "MESH" and not item.hide_render and len(item.data.polygons)]
