"""Runs inside Blender with a window: splats drawn by the shader for graphics cards, whatever stands in for a card.

    blender --python card_story.py -- FOLDER

FOLDER/twin.ply is the twin; FOLDER/pictures gets the screenshots, FOLDER/card-N.npy what the shader blended,
FOLDER/story.json what was seen.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Quaternion, Vector

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
ADDON = "bl_ext.user_default.dgs"
#: Views: turn from the first one about the vertical, and distance.
VIEWS = ((0.0, 5.0), (0.9, 3.2), (2.5, 8.0))
seen: dict[str, Any] = {"blender": bpy.app.version_string}


def _addon(module: str) -> Any:
    """A module of the installed extension."""
    return import_module(f"{ADDON}.{module}")


def story(robot: Robot) -> Story:
    """Who draws by itself; then the shader, in Solid and in Rendered mode, beside the engine."""
    scene, preferences = bpy.context.scene, bpy.context.preferences.addons[ADDON].preferences
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene.view_settings.view_transform = "Standard"
    seen["automatic"] = _said()
    bpy.ops.dgs.open_preferences()
    yield 1.5
    yield from robot.picture("preferences")
    for window in bpy.context.window_manager.windows[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    preferences.draw_with = "CARD"
    seen["asked for"] = _said()
    bpy.ops.dgs.import_twin(filepath=str(FOLDER / "twin.ply"))
    twin = next(thing for thing in scene.objects if "dgs_harmonics" in thing)
    yield 1.0
    space = robot.area().spaces.active
    for bar in ("header", "toolbar", "ui", "tool_header"):
        setattr(space, f"show_region_{bar}", False)
    space.show_gizmo, space.overlay.show_overlays = False, False
    view = space.region_3d
    view.view_perspective, view.view_location = "PERSP", twin.matrix_world @ Vector((0.0, 0.0, 0.0))
    view.view_rotation, view.view_distance = Quaternion((1, 0, 0), 1.5707963), 5.0
    yield from _settled("first")
    seen["said"] = _said()
    yield from robot.picture("solid")
    yield from _among_meshes(robot, view)
    scene.render.engine, space.shading.type = "DESCATTER", "RENDERED"
    yield from _views_of(robot, view, twin)
    yield from _among_meshes(robot, view, "rendered-")
    yield from _moved(robot, view, twin)
    yield from _timed(robot, space, preferences)
    seen["server"] = _addon("dgs_addon.drawing.process").draws()


def _views_of(robot: Robot, view: Any, twin: Any) -> Story:
    """Three views; what the shader blended, and their cameras for the command line."""
    cameras, region = {}, _region(robot)
    seen["region"] = [region.x, region.y, region.width, region.height]
    upright = view.view_rotation.copy()
    for number, (turn, distance) in enumerate(VIEWS):
        view.view_rotation = Quaternion((0, 0, 1), turn) @ upright
        view.view_distance = distance
        yield from _settled(f"view {number}")
        yield from robot.picture(f"rendered-{number}")
        cameras[f"{number}.png"] = _camera(robot, view)
        np.save(FOLDER / f"card-{number}.npy", _shown().card.pixels())
    _addon("core.formats.transforms").write_transforms(FOLDER / "transforms.json", cameras)
    view.view_rotation, view.view_distance = upright, 5.0
    yield from _settled("back")


def _among_meshes(robot: Robot, view: Any, mode: str = "") -> Story:
    """A white wall behind the middle of the twin, then in front of it."""
    towards = view.view_rotation @ Vector((0.0, 0.0, 1.0))
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    wall = bpy.context.object
    for name, way in (("behind", -2.0), ("front", 2.0)):
        wall.location = view.view_location + way * towards
        yield from _settled(mode + name)
        yield from robot.picture(f"{mode}mesh-{name}")
    bpy.data.objects.remove(wall)
    yield from _settled("alone")


def _moved(robot: Robot, view: Any, twin: Any) -> Story:
    """Turned, scaled and stretched, cropped and without perspective: the shader and the engine draw the same."""
    before = twin.matrix_world.copy()
    preferences = bpy.context.preferences.addons[ADDON].preferences
    twin.rotation_euler, twin.scale = (0.4, -0.3, 1.1), (1.3, 0.7, 0.9)
    yield 0.5
    others = set(bpy.data.objects)
    bpy.ops.dgs.crop_twin()
    box = next(thing for thing in bpy.data.objects if thing not in others)
    box.scale.x *= 0.5
    box.hide_set(True)
    for name in ("PERSP", "ORTHO"):
        view.view_perspective = name
        for who in ("CARD", "ENGINE"):
            preferences.draw_with = who
            yield from _settled(f"{name} {who}")
            yield from robot.picture(f"moved-{name}-{who}")
    preferences.draw_with = "CARD"
    bpy.data.objects.remove(box)
    twin.matrix_world, view.view_perspective = before, "PERSP"
    yield from _settled("as before")


def _timed(robot: Robot, space: Any, preferences: Any) -> Story:
    """Seconds of a picture by either, and how often the window is drawn while the view turns."""
    card, drawer = (_addon(f"dgs_addon.drawing.{name}") for name in ("card", "drawer"))
    shown, view = _shown(), _asked(robot, space)
    yield from _while_drawn(
        robot, lambda: seen.update({"card seconds": card.seconds_of(shown.card, drawer.the_card(), view)})
    )
    seen["order seconds"] = _order_seconds(drawer.the_card(), view)
    for who in ("CARD", "ENGINE"):
        preferences.draw_with = who
        yield from _settled(who)
        draws: list[float] = []
        handle = bpy.types.SpaceView3D.draw_handler_add(
            lambda draws=draws: draws.append(time.perf_counter()), (), "WINDOW", "POST_PIXEL"
        )
        began = time.perf_counter()
        while time.perf_counter() - began < 4.0:
            space.region_3d.view_rotation = Quaternion((0, 0, 1), 0.02) @ space.region_3d.view_rotation
            yield 0.005
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        seen[f"orbit {who}"] = {
            "draws": len(draws) / 4.0,
            "gap": max((b - a for a, b in zip(draws, draws[1:], strict=False)), default=None),
            "load": os.getloadavg()[0],
        }
        yield from _settled(f"{who} again")
    seen["engine seconds"] = min(_engine_seconds(view) for _ in range(3))


def _while_drawn(robot: Robot, work: Any) -> Story:
    """Does something once while a view is drawn: only then the card may be used."""
    done: list[object] = []

    def once() -> None:
        if not done:
            done.append(1)
            work()
            done.append(2)

    handle = bpy.types.SpaceView3D.draw_handler_add(once, (), "WINDOW", "POST_PIXEL")
    _region(robot).tag_redraw()
    while len(done) < 2:
        yield 0.05
    bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")


def _asked(robot: Robot, space: Any) -> Any:
    """The present view, as the engine is asked for it."""
    messages, twins = _addon("core.serving.messages"), _addon("dgs_addon.drawing.twins")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    placed = twins.placed_twins(depsgraph, _addon("dgs_addon.drawing.drawer").the_card().twins)
    return messages.View(placed, _camera(robot, space.region_3d), False, True, (0.0, 0.0, 0.0))


def _engine_seconds(view: Any) -> float:
    server = _addon("dgs_addon.drawing.process").picture_server()
    _addon("dgs_addon.drawing.twins").placed_twins(bpy.context.evaluated_depsgraph_get(), server, fresh=True)
    server.ask("timed", view)
    return float(server.wait("timed", 60).seconds)


def _order_seconds(card: Any, view: Any) -> float:
    splats = _addon("dgs_addon.drawing.splats")
    loaded = card.loaded(view.twins)
    stands, times = splats.standing(loaded.splats, view.twins, view.camera), []
    for _ in range(5):
        began = time.perf_counter()
        splats.far_to_near(loaded.splats, loaded.kept(view.twins), stands.rows)
        times.append(time.perf_counter() - began)
    return min(times)


def _camera(robot: Robot, view: Any) -> Any:
    region = _region(robot)
    camera = _addon("dgs_addon.drawing.view_camera").window_camera
    return camera(view.view_matrix, view.window_matrix, region.width, region.height)[0]


def _said() -> list[object]:
    drawn_by = _addon("dgs_addon.drawing.drawer").drawer()
    return [drawn_by.card, drawn_by.why, gpu.platform.renderer_get(), gpu.platform.device_type_get()]


def _shown() -> Any:
    return next(iter(_views()))


def _views() -> list[Any]:
    return list(_addon("dgs_addon.drawing.viewport")._views.values())


def _region(robot: Robot) -> Any:
    return next(region for region in robot.area().regions if region.type == "WINDOW")


def _settled(name: str, seconds: float = 500.0) -> Story:
    """Until all views show what they look at."""
    began = time.monotonic()
    yield 0.5
    while not _views() or not all(shown.done for shown in _views()):
        if time.monotonic() - began > seconds:
            raise TimeoutError(f"{name}: not in {seconds} s; {_said()}; {_views()}")
        yield 0.02
    yield 0.5


def _done(error: str) -> None:
    seen["failure"] = error
    (FOLDER / "story.json").write_text(json.dumps(seen), encoding="utf-8")


bpy.context.preferences.view.show_splash = False
(FOLDER / "pictures").mkdir(exist_ok=True)
robot = Robot(FOLDER / "pictures")
robot.play(story(robot), _done)
