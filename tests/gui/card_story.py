"""Runs inside Blender with a window: splats drawn by the shader for graphics cards, whatever stands in for a card.

    blender --python card_story.py -- FOLDER

FOLDER/twin.ply is the twin; FOLDER/pictures gets the screenshots, FOLDER/card-N.npy what the shader blended,
FOLDER/story.json what was seen.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Quaternion

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import (
    ADDON,
    FOLDER,
    addon,
    among_meshes,
    bare,
    drawn_views,
    imported_alone,
    play,
    seen,
    seen_from_the_front,
    until,
    view_region,
)

#: Views: turn from the first one about the vertical, and distance.
VIEWS = ((0.0, 5.0), (0.9, 3.2), (2.5, 8.0))


def story(robot: Robot) -> Story:
    """Who draws by itself; then the shader, in Solid and in Rendered mode, beside the engine."""
    scene, preferences = bpy.context.scene, bpy.context.preferences.addons[ADDON].preferences
    seen["automatic"] = _said()
    bpy.ops.dgs.open_preferences()
    yield 1.5
    yield from robot.picture("preferences")
    for window in bpy.context.window_manager.windows[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    preferences.draw_with = "CARD"
    seen["asked for"] = _said()
    twin = imported_alone()
    yield 1.0
    space = robot.area().spaces.active
    bare(space)
    view = seen_from_the_front(space, twin)
    yield from _settled("first")
    seen["said"] = _said()
    yield from robot.picture("solid")
    yield from among_meshes(robot, view, _settled)
    scene.render.engine, space.shading.type = "DESCATTER", "RENDERED"
    yield from _views_of(robot, view, twin)
    yield from among_meshes(robot, view, _settled, "rendered-")
    yield from _moved(robot, view, twin)
    yield from _timed(robot, space, preferences)
    seen["server"] = addon("dgs_addon.drawing.process").draws()


def _views_of(robot: Robot, view: Any, twin: Any) -> Story:
    """Three views; what the shader blended, and their cameras for the command line."""
    cameras, region = {}, view_region(robot)
    seen["region"] = [region.x, region.y, region.width, region.height]
    upright = view.view_rotation.copy()
    for number, (turn, distance) in enumerate(VIEWS):
        view.view_rotation = Quaternion((0, 0, 1), turn) @ upright
        view.view_distance = distance
        yield from _settled(f"view {number}")
        yield from robot.picture(f"rendered-{number}")
        cameras[f"{number}.png"] = _camera(robot, view)
        np.save(FOLDER / f"card-{number}.npy", _shown().card.pixels())
    addon("core.formats.transforms").write_transforms(FOLDER / "transforms.json", cameras)
    view.view_rotation, view.view_distance = upright, 5.0
    yield from _settled("back")


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
    card, drawer = (addon(f"dgs_addon.drawing.{name}") for name in ("card", "drawer"))
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
    view_region(robot).tag_redraw()
    while len(done) < 2:
        yield 0.05
    bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")


def _asked(robot: Robot, space: Any) -> Any:
    """The present view, as the engine is asked for it."""
    messages, twins = addon("core.serving.messages"), addon("dgs_addon.drawing.twins")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    placed = twins.placed_twins(depsgraph, addon("dgs_addon.drawing.drawer").the_card().twins)
    return messages.View(placed, _camera(robot, space.region_3d), False, True, (0.0, 0.0, 0.0))


def _engine_seconds(view: Any) -> float:
    server = addon("dgs_addon.drawing.process").picture_server()
    addon("dgs_addon.drawing.twins").placed_twins(bpy.context.evaluated_depsgraph_get(), server, fresh=True)
    server.ask("timed", view)
    return float(server.wait("timed", 60).seconds)


def _order_seconds(card: Any, view: Any) -> float:
    splats = addon("dgs_addon.drawing.splats")
    loaded = card.loaded(view.twins)
    stands, times = splats.standing(loaded.splats, view.twins, view.camera), []
    for _ in range(5):
        began = time.perf_counter()
        splats.far_to_near(loaded.splats, loaded.kept(view.twins), stands.rows)
        times.append(time.perf_counter() - began)
    return min(times)


def _camera(robot: Robot, view: Any) -> Any:
    region = view_region(robot)
    camera = addon("dgs_addon.drawing.view_camera").window_camera
    return camera(view.view_matrix, view.window_matrix, region.width, region.height)[0]


def _said() -> list[object]:
    drawn_by = addon("dgs_addon.drawing.drawer").drawer()
    return [drawn_by.card, drawn_by.why, gpu.platform.renderer_get(), gpu.platform.device_type_get()]


def _shown() -> Any:
    return next(iter(drawn_views()))


def _settled(name: str, seconds: float = 500.0) -> Story:
    """Until all views show what they look at."""
    yield 0.5
    yield from until(_complete, seconds, 0.02, f"{name}, {_said()}:")
    yield 0.5


def _complete() -> bool:
    views = drawn_views()
    return bool(views) and all(shown.done for shown in views)


play(story)
