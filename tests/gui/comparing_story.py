"""Runs inside Blender with a window: a twin is compared with an earlier one.

    blender --python comparing_story.py -- FOLDER

FOLDER/week1/twin and FOLDER/week2/twin are the twins, FOLDER/known.json a length in the world of the later one;
FOLDER/pictures gets the screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import FOLDER, addon, in_german, in_view, play, seen, until

#: Where the button that shows the changes is in the sidebar's width.
_EYE = 0.81


def story(robot: Robot) -> Story:
    """Compared, cancelled once, shown in Solid and Material Preview, in German, switched off and undone."""
    scene = bpy.context.scene
    twin = addon("dgs_addon.job.results").add_twin_of(FOLDER / "week2" / "twin", scene)
    yield 1.0
    view = robot.area().spaces.active
    view.region_3d.view_location += view.region_3d.view_rotation @ Vector((0.3 * view.region_3d.view_distance, 0, 0))
    view.region_3d.view_distance *= 1.3
    robot.area().regions[0].tag_redraw()
    yield from robot.open_tab("Descatter")
    yield from _known_length(robot, twin)
    runner = addon("dgs_addon.job.runner")
    _compare(robot)
    yield from until(lambda: runner.current().state.stage in ("depth", "compare"))
    runner.pause(True)  # the robot takes longer to find the button than the comparison
    yield 1.0
    yield from robot.picture("1-running")
    yield from robot.press("dgs.cancel_job", 0.6)
    yield from until(lambda: not runner.busy())
    seen["cancelled"] = [runner.current().state.phase, _mesh(twin) is None]
    yield from robot.picture("2-cancelled")
    began = time.monotonic()
    _compare(robot)
    yield from until(lambda: not runner.busy(), 500)
    seen["seconds"] = time.monotonic() - began
    seen["ended"] = [runner.current().state.phase, runner.current().state.error]
    yield 1.0
    yield from robot.reach("dgs.show_changes", _EYE)
    yield from robot.scroll(3)
    yield from robot.point(400, 600)  # else the tooltip stays
    yield 1.0
    yield from robot.picture("3-solid")
    seen["changes"] = addon("dgs_addon.scene.comparison").changes_of(twin)
    seen["shown"] = [twin.hide_get(), _mesh(twin).hide_get()]
    view.shading.type = "MATERIAL"
    yield 20.0
    yield from robot.picture("4-material")
    view.shading.type = "SOLID"
    yield from in_german(robot, "5-german")
    yield from robot.press("dgs.show_changes", _EYE)
    seen["switched"] = [twin.hide_get(), _mesh(twin).hide_get()]
    yield 2.0
    yield from robot.picture("6-twin")
    with in_view(robot):
        bpy.ops.ed.undo()  # of the switch
        yield 1.0
        bpy.ops.ed.undo()  # of the comparison
    yield 1.0
    twin = next(thing for thing in bpy.context.scene.objects if "dgs_harmonics" in thing)
    seen["undone"] = [twin.hide_get(), _mesh(twin) is None]
    yield from robot.picture("7-undone")


def _known_length(robot: Robot, twin: Any) -> Story:
    known = json.loads((FOLDER / "known.json").read_text("utf-8"))
    world = Matrix(addon("dgs_addon.scene.measures").from_file(twin).tolist())
    points = "; ".join(" ".join(map(str, (world @ Vector((*end, 1.0))).to_3d())) for end in known["ends"])
    with in_view(robot):
        bpy.ops.dgs.measure("EXEC_DEFAULT", kind="length", name=known["name"], points=points)
        bpy.ops.dgs.know_length("EXEC_DEFAULT", length=known["length"], unit=known["unit"])
    yield from until(lambda: twin.dgs_measures.items[0].unit == known["unit"])
    with in_view(robot):
        bpy.ops.ed.undo_push(message="Twin")  # (a script that adds one leaves that to whoever runs it)


def _compare(robot: Robot) -> None:
    with in_view(robot):
        bpy.ops.dgs.compare_earlier("EXEC_DEFAULT", directory=str(FOLDER / "week1" / "twin"))


def _mesh(twin: Any) -> Any:
    return addon("dgs_addon.scene.comparison").changed_mesh(twin)


play(story)
