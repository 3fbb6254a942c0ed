"""Runs inside Blender with a window: a twin is measured with the mouse.

    blender --python measure_story.py -- FOLDER

FOLDER/twin is the twin, FOLDER/places.json its places by name and the clicks of each measure; FOLDER/pictures gets the
screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import FOLDER, addon, in_german, in_view, play, seen, until, view_region

asked: dict[str, Any] = json.loads((FOLDER / "places.json").read_text("utf-8"))


def story(robot: Robot) -> Story:
    """Measures of all kinds by clicks, a miss, a known length, German, the mesh, and the file opened again."""
    scene = bpy.context.scene
    twin = addon("dgs_addon.job.results").add_twin_of(FOLDER / "twin", scene)
    yield 1.0
    view = robot.area().spaces.active.region_3d
    view.view_distance *= asked.get("farther", 1.5)
    view.view_location += view.view_rotation @ Vector((asked.get("aside", 0.3) * view.view_distance, 0.0, 0.0))
    yield from robot.open_tab("Descatter")
    yield from robot.reach("dgs.make_mesh")
    yield from robot.point(5, 880)
    yield 1.0
    for name, kind, places in asked["measures"]:
        began = time.monotonic()
        yield from _measure(robot, twin, name, kind, places)
        seen["measures"] = [[item.name, item.kind, item.value, item.low, item.high] for item in _items(twin)]
        seen[f"seconds {name}"] = time.monotonic() - began
    yield from robot.picture("2-all")
    yield from _missed(robot, twin)
    twin.dgs_measures.active = 0
    with in_view(robot):
        bpy.ops.dgs.know_length("EXEC_DEFAULT", **asked["known"])
    yield from until(lambda: _items(twin)[0].known and _items(twin)[1].unit == asked["known"]["unit"])
    twin.dgs_measures.active = 1
    yield from robot.picture("4-known")
    yield from in_german(robot, "5-german")
    yield from _mesh(robot, twin)
    yield from _opened_again(robot)


def _measure(robot: Robot, twin: Any, name: str, kind: str, places: list[str]) -> Story:
    before = len(_items(twin))
    with in_view(robot):
        bpy.ops.dgs.measure("INVOKE_DEFAULT", kind=kind, name=name)
    for number, place in enumerate(places):
        yield from _click(robot, twin, asked["places"][place])
        yield from until(lambda number=number: len(_pending().places) > number if _pending() else True)
        if number == 0 and before == 0:
            yield from robot.point(*_at(robot, twin, asked["places"][places[1]]))
            yield 1.0
            yield from robot.picture("1-setting", out_of_the_way=False)
    if kind in ("polyline", "area"):
        robot.key("Return")
    yield from until(lambda: _pending() is None and len(_items(twin)) > before)


def _missed(robot: Robot, twin: Any) -> Story:
    """A click where nothing is: said, and nothing is kept; Escape ends it."""
    before = len(_items(twin))
    with in_view(robot):
        bpy.ops.dgs.measure("INVOKE_DEFAULT", kind="length")
    yield from _click(robot, twin, asked["nothing"])
    yield 2.0
    seen["missed"] = [len(_pending().places), _pending().hover is None]
    yield from robot.picture("3-missed", out_of_the_way=False)
    robot.key("Escape")
    yield from until(lambda: _pending() is None)
    seen["kept"] = len(_items(twin)) - before


def _mesh(robot: Robot, twin: Any) -> Story:
    with in_view(robot):
        bpy.ops.dgs.make_mesh(faces=20_000)
    yield from until(lambda: not addon("dgs_addon.questions.meshes").making(), 900)
    seen["mesh error"] = addon("dgs_addon.questions.meshes").error
    surfaces = [child for child in twin.children if child.get("dgs_surface")]
    seen["mesh"] = [len(surface.data.polygons) for surface in surfaces]
    twin.hide_set(True)
    yield 2.0
    yield from robot.picture("6-mesh")
    twin.hide_set(False)


def _opened_again(robot: Robot) -> Story:
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "work.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "work.blend"))
    yield 2.0
    twin = next(thing for thing in bpy.context.scene.objects if "dgs_harmonics" in thing)
    seen["opened again"] = [[item.name, item.kind, item.value, item.low, item.high] for item in _items(twin)]


def _click(robot: Robot, twin: Any, place: list[float]) -> Story:
    yield from robot.point(*_at(robot, twin, place))
    yield 0.3
    robot.click()
    yield 0.3


def _at(robot: Robot, twin: Any, place: list[float]) -> tuple[int, int]:
    """Where a place of the twin's file is on the screen."""
    region, window = view_region(robot), bpy.context.window_manager.windows[0]
    world = Matrix(addon("dgs_addon.scene.measures").from_file(twin).tolist()) @ Vector((*place, 1.0))
    found = location_3d_to_region_2d(region, robot.area().spaces.active.region_3d, world.to_3d())
    return round(region.x + found.x), round(window.height - region.y - found.y)


def _items(twin: Any) -> Any:
    return twin.dgs_measures.items


def _pending() -> Any:
    return addon("dgs_addon.drawing.measures").pending


play(story)
