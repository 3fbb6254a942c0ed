"""Runs inside Blender with a window: a twin is cleaned up with Blender's own tools of selection.

    blender --python edit_story.py -- FOLDER

FOLDER/twin.ply is the twin; FOLDER/pictures gets the screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import addon, imported_alone, in_view, play, seen, seen_from_the_front, settled, view_region


def story(robot: Robot) -> Story:
    """Selecting, hiding, deleting, undoing, bringing back."""
    twin = imported_alone()
    yield 1.0
    space = robot.area().spaces.active
    space.overlay.show_floor = space.overlay.show_axis_x = space.overlay.show_axis_y = False
    seen_from_the_front(space, twin)
    bpy.ops.ed.undo_push(message="ready")
    yield from settled("object")
    region = view_region(robot)
    seen["region"] = [region.x, region.y, region.width, region.height]
    yield from robot.open_tab("Descatter")
    yield from robot.picture("object")
    with in_view(robot):
        began = time.perf_counter()
        bpy.ops.dgs.edit_splats()
        seen["edit mode"] = time.perf_counter() - began
        bpy.ops.mesh.select_all(action="DESELECT")
    yield from settled("edit")
    yield from robot.picture("edit")
    yield from _by_mouse(robot, space)
    yield from _by_measures(robot)
    yield from _hidden_and_back(robot, twin)
    yield from _deleted_and_back(robot, twin)


def _by_mouse(robot: Robot, space: Any) -> Story:
    """A box, a lasso and a circle around the middle, drawn with the mouse, with X-ray and without."""
    for xray in (False, True):
        space.shading.show_xray = xray
        yield from settled(f"x-ray {xray}")
        for tool, way in (
            ("select_box", [(-90, -60), (90, 60)]),
            ("select_lasso", [(-90, -60), (90, -60), (90, 60), (-90, 60), (-90, -60)]),
            ("select_circle", [(-60, 0), (60, 0)]),
        ):
            with in_view(robot):
                bpy.ops.mesh.select_all(action="DESELECT")
                bpy.ops.wm.tool_set_by_id(name=f"builtin.{tool}")
            yield 1.0
            yield from robot.drag([_middle(robot, *offset) for offset in way])
            yield 0.5
            chosen = _rows("select")
            seen[f"{tool} {xray}"] = _inside(robot, chosen)
            yield from settled(f"{tool} {xray}")
            yield from robot.picture(f"{tool}-{'xray' if xray else 'solid'}")
    space.shading.show_xray = False


def _by_measures(robot: Robot) -> Story:
    with in_view(robot):
        bpy.ops.dgs.select_floaters("INVOKE_DEFAULT")
    yield from settled("floaters")
    seen["floaters"] = int(_rows("select").sum())
    yield from robot.picture("floaters")
    with in_view(robot):
        bpy.ops.dgs.select_by_colour("INVOKE_DEFAULT", colour=(0.84, 0.67, 0.33), tolerance=0.12)
    yield from settled("colour")
    seen["colour"] = int(_rows("select").sum())
    yield from robot.picture("colour")


def _hidden_and_back(robot: Robot, twin: Any) -> Story:
    """Key H of Blender itself; then in Object Mode, and back by Alt-H."""
    yield from robot.point(*_middle(robot, 0, 0))
    robot.key("h")
    yield 1.0
    yield from settled("hidden")
    seen["hidden"] = int(_rows("hide").sum())
    yield from robot.picture("hidden")
    with in_view(robot):
        bpy.ops.dgs.edit_splats()
    yield 0.5
    yield from settled("hidden, object")
    seen["marked"] = int(sum(value.value for value in twin.data.attributes["hidden"].data))
    yield from robot.picture("hidden-object")
    with in_view(robot):
        bpy.ops.dgs.edit_splats()
    yield from robot.point(*_middle(robot, 0, 0))
    robot.key("alt+h")
    yield 1.0
    seen["shown again"] = int(_rows("hide").sum())


def _deleted_and_back(robot: Robot, twin: Any) -> Story:
    """Delete, undo by Ctrl-Z, delete again, and bring back from the file."""
    count = len(_rows("select"))
    with in_view(robot):
        bpy.ops.dgs.delete_splats("INVOKE_DEFAULT")
        bpy.ops.ed.undo_push(message="deleted")
    yield from settled("deleted")
    seen["deleted"] = count - len(_rows("select"))
    yield from robot.picture("deleted")
    yield from robot.point(*_middle(robot, 0, 0))
    robot.key("ctrl+z")
    yield 1.0
    seen["undone"] = count - len(_rows("select"))
    robot.key("ctrl+shift+z")
    yield 1.0
    seen["redone"] = count - len(_rows("select"))
    with in_view(robot):
        bpy.ops.dgs.restore_splats()
        bpy.ops.dgs.edit_splats()
    yield 0.5
    yield from settled("restored")
    seen["restored"] = count - len(twin.data.vertices)
    yield from robot.picture("restored")


def _middle(robot: Robot, right: int, down: int) -> tuple[int, int]:
    """Where the mouse is to go, from the middle of the view."""
    region, window = view_region(robot), bpy.context.window_manager.windows[0]
    return region.x + region.width // 2 + right, window.height - region.y - region.height // 2 + down


def _rows(flag: str) -> Any:
    """[N] a flag of the twin's points, in any mode."""
    reading, twin = addon("dgs_addon.scene.reading"), bpy.context.view_layer.objects.active
    with reading.readable(twin) as mesh:
        return reading.read_flags(mesh, flag)


def _inside(robot: Robot, chosen: Any) -> list[int]:
    """How many are selected, how many of these lie in the box, how many lie in it, and how many of these behind."""
    import numpy as np  # late: Blender has it, whoever reads this file may not

    twin, region = bpy.context.view_layer.objects.active, view_region(robot)
    reading, view = addon("dgs_addon.scene.reading"), robot.area().spaces.active.region_3d
    with reading.readable(twin) as mesh:
        places = reading.read_values(mesh, "position", "vector", 3)
    world = np.array(twin.matrix_world)
    flat = np.c_[places @ world[:3, :3].T + world[:3, 3], np.ones(len(places))] @ np.array(view.perspective_matrix).T
    across, up = (flat[:, 0] / flat[:, 3] * region.width / 2, flat[:, 1] / flat[:, 3] * region.height / 2)
    box = (np.abs(across) < 90) & (np.abs(up) < 60)
    behind = flat[:, 3] > np.median(flat[:, 3])
    return [int(x) for x in (chosen.sum(), (chosen & box).sum(), box.sum(), (chosen & box & behind).sum())]


play(story)
