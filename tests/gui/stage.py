"""Runs inside Blender: what all stories share: their folder, the add-on, the view, waiting, and how one is played."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
from mathutils import Quaternion, Vector
from robot import Robot, Story

#: The story's own: what it needs, pictures/ with its screenshots, and story.json with what was seen.
FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
ADDON = "bl_ext.user_default.dgs"
#: What a story has seen; it ends up in story.json.
seen: dict[str, Any] = {"blender": bpy.app.version_string}


def addon(module: str) -> Any:
    """A module of the installed extension."""
    return import_module(f"{ADDON}.{module}")


def imported_alone() -> Any:
    """The twin of FOLDER/twin.ply, with nothing beside it, in the colours that it has."""
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene.view_settings.view_transform = "Standard"
    bpy.ops.dgs.import_twin(filepath=str(FOLDER / "twin.ply"))
    return next(thing for thing in scene.objects if "dgs_harmonics" in thing)


def bare(space: Any) -> None:
    """Leaves nothing in a 3D view but what it shows."""
    for bar in ("header", "toolbar", "ui", "tool_header"):
        setattr(space, f"show_region_{bar}", False)
    space.show_gizmo, space.overlay.show_overlays = False, False


def seen_from_the_front(space: Any, twin: Any) -> Any:
    """The region of a 3D view, which looks at the middle of a twin."""
    view = space.region_3d
    view.view_perspective, view.view_location = "PERSP", twin.matrix_world @ Vector((0.0, 0.0, 0.0))
    view.view_rotation, view.view_distance = Quaternion((1, 0, 0), 1.5707963), 5.0
    return view


def view_region(robot: Robot) -> Any:
    """Where a 3D view shows the scene."""
    return next(region for region in robot.area().regions if region.type == "WINDOW")


def in_view(robot: Robot) -> Any:
    """As if the mouse were above the 3D view."""
    window = bpy.context.window_manager.windows[0]
    return bpy.context.temp_override(window=window, area=robot.area(), region=view_region(robot))


def drawn_views() -> list[Any]:
    """The 3D views that the add-on draws splats in."""
    return list(addon("dgs_addon.drawing.viewport")._views.values())


def until(true: Callable[[], object], seconds: float = 200.0, every: float = 0.05, why: str = "") -> Story:
    """Waits for something to be true."""
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            raise TimeoutError(f"{why} not in {seconds} s")
        yield every


def settled(name: str, seconds: float = 200.0) -> Story:
    """Until all views show the full picture of what they look at."""
    began = time.monotonic()
    yield 1.0
    yield from until(_complete, seconds, 0.02, name)
    seen[f"settled {name}"] = time.monotonic() - began
    yield 0.5


def _complete() -> bool:
    views = drawn_views()
    return bool(views) and all(shown.follower.done and shown.follower.picture for shown in views)


def among_meshes(robot: Robot, view: Any, waits: Callable[[str], Story], mode: str = "") -> Story:
    """A white wall behind the middle of the twin, then in front of it; `waits` until views show a name's state."""
    towards = view.view_rotation @ Vector((0.0, 0.0, 1.0))
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    wall = bpy.context.object
    for name, way in (("behind", -2.0), ("front", 2.0)):
        wall.location = view.view_location + way * towards
        yield from waits(mode + name)
        yield from robot.picture(f"{mode}mesh-{name}")
    bpy.data.objects.remove(wall)
    yield from waits("alone")


def in_german(robot: Robot, picture: str, ask: Callable[[], None] = lambda: None) -> Story:
    """A picture of Blender in German, and whatever is asked meanwhile."""
    view = bpy.context.preferences.view
    before = view.language
    try:
        view.language = "de_DE"
    except TypeError:  # a Blender without its languages
        return
    view.use_translate_interface = True
    yield 1.0
    ask()
    yield from robot.picture(picture)
    view.language = before
    yield 0.5


def play(story: Callable[[Robot], Story]) -> None:
    """Plays a story from beginning to end, and then ends Blender."""
    bpy.context.preferences.view.show_splash = False
    (FOLDER / "pictures").mkdir(exist_ok=True)
    robot = Robot(FOLDER / "pictures")
    robot.play(story(robot), _written)


def _written(error: str) -> None:
    seen["failure"] = error
    (FOLDER / "story.json").write_text(json.dumps(seen), encoding="utf-8")
