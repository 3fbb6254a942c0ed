"""Runs inside Blender with a window: a twin arrives in Blender's own new file, is looked at, is compared with photos.

    blender --python view_story.py -- FOLDER

FOLDER holds photos, sharp photos and the results of a run; FOLDER/pictures gets the screenshots, FOLDER/story.json what
was seen.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import FOLDER, addon, drawn_views, in_view, play, seen, settled, until


def story(robot: Robot) -> Story:
    """A data set, arrival, View Twin, comparisons."""
    yield from _data_set_is_dropped(robot)
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "saved.blend"))
    settings = bpy.context.scene.dgs
    settings.photos, settings.out, settings.truth = (f"//{name}" for name in ("photos", "out", "sharp"))
    settings.medium, settings.sigma = "gaussian", 3.0
    yield from _arrives(robot)
    yield from _viewed(robot)
    yield from _compared(robot)
    yield from _dragged(robot)
    yield from _outdated(robot)
    _saved()
    _among_meshes()


def _data_set_is_dropped(robot: Robot) -> Story:
    """Cameras that lie with their photos are dropped: the panel takes both."""
    settings, window = bpy.context.scene.dgs, bpy.context.window_manager.windows[0]
    yield from robot.open_tab("Descatter")
    with bpy.context.temp_override(window=window, area=robot.area(), region=robot.sidebar()):
        files = [{"name": "transforms_train.json"}]
        bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=str(FOLDER / "set"), files=files)
    yield 1.0
    if not settings.photos:  # Blender asks which of its handlers is to take it
        yield from robot.picture("data-set-menu", out_of_the_way=False)
        robot.key("Return")
        yield 1.0
    yield from robot.picture("data-set")
    seen["data set"] = [settings.photos, settings.cameras, settings.model]
    settings.photos = ""
    seen["without it"] = [settings.cameras, settings.model]


def _arrives(robot: Robot) -> Story:
    began = time.monotonic()
    bpy.ops.dgs.add_results()
    seen["operator"] = time.monotonic() - began
    yield from until(_splats_are_drawn, 200, 0.02)
    seen["first"] = {"seconds": time.monotonic() - began, "load": os.getloadavg()[0]}
    yield from robot.open_tab("Descatter")
    yield from settled("arrived")
    yield from robot.picture("arrival")
    seen["engine"] = bpy.context.scene.render.engine
    overlay = robot.area().spaces.active.overlay
    seen["across"] = [getattr(overlay, f"show_{name}") for name in ("relationship_lines", "floor", "axis_x", "axis_y")]


def _viewed(robot: Robot) -> Story:
    space = robot.area().spaces.active
    for name in ("view", "view-again"):
        with in_view(robot):
            bpy.ops.dgs.view_twin()
        yield from settled(name)
        yield from robot.picture(name)
        seen[name] = [space.shading.type, space.region_3d.view_perspective, space.overlay.show_overlays]


def _compared(robot: Robot) -> Story:
    settings = bpy.context.scene.dgs
    with in_view(robot):
        bpy.ops.dgs.split_view()
    began = time.monotonic()
    yield from until(lambda: settings.exact_other is not None, 60)
    seen["exact"] = [time.monotonic() - began, list(settings.exact_view.size), list(settings.exact_other.size)]
    split = addon("dgs_addon.questions.split_view")
    for against in ("photo", "truth", "medium", "difference"):
        settings.split_against = against
        yield 0.5
        yield from robot.picture(f"split-{against}")
        assert not addon("dgs_addon.questions.exact").is_outdated(bpy.context.object, bpy.context.scene)
    with in_view(robot):
        seen["frame"] = list(split.frame_of(bpy.context))
    region = next(region for region in robot.area().regions if region.type == "WINDOW")
    seen["region"] = [region.x, region.y, region.width, region.height]


def _dragged(robot: Robot) -> Story:
    """The line is dragged to a quarter of the frame with the mouse; then again, and Escape puts it back."""
    settings, window = bpy.context.scene.dgs, bpy.context.window_manager.windows[0]
    settings.split_against = "photo"
    left, bottom, right, top = seen["frame"]
    x, y = seen["region"][:2]
    height = window.height - (y + 0.4 * bottom + 0.6 * top)
    for share, key in ((0.25, ""), (0.6, "Escape")):
        start, end = (x + left + part * (right - left) for part in (settings.split_at, share))
        _mouse("mousemove", round(start) + 3, round(height))
        yield 0.4
        _mouse("mousemove", round(start), round(height))
        yield 0.4
        _mouse("mousedown", 1)
        yield 0.3
        for part in (0.3, 0.6, 1.0):
            _mouse("mousemove", round(start + part * (end - start)), round(height))
            yield 0.2
        if key:
            seen["while dragged"] = settings.split_at
            robot.key(key)
            yield 0.3
        _mouse("mouseup", 1)
        yield 0.5
        seen[f"dragged {share}"] = settings.split_at
    yield from robot.picture("split-dragged")


def _outdated(robot: Robot) -> Story:
    scene = bpy.context.scene
    scene.camera.location.x += 0.2
    yield 0.5
    yield from robot.picture("split-outdated")
    with in_view(robot):
        bpy.ops.dgs.split_view()
    seen["off"] = scene.dgs.split_shown


def _saved() -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "saved.blend"))
    images = (bpy.context.scene.dgs.exact_view, bpy.context.scene.dgs.exact_other)
    seen["packed"] = [image.packed_file is not None for image in images]


def _among_meshes() -> None:
    """Final pictures: the twin alone, then with a cube before its middle and another behind."""
    scene = bpy.context.scene
    render, camera = scene.render, scene.camera
    render.film_transparent, render.dither_intensity = True, 0.0
    render.image_settings.color_mode = "RGBA"
    _render("alone")
    for away, size in ((2.4, 0.4), (6.0, 1.0)):
        place = camera.matrix_world @ Vector((0.0, 0.0, -away))
        bpy.ops.mesh.primitive_cube_add(size=size, location=place, rotation=camera.matrix_world.to_euler())
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = 1, False, "BOX"
    seen["composite"] = list(bpy.ops.dgs.composite_meshes(meshes="CYCLES"))
    _render("among")


def _render(name: str) -> None:
    bpy.context.scene.render.filepath = str(FOLDER / f"{name}.png")
    bpy.ops.render.render(write_still=True)


def _splats_are_drawn() -> bool:
    shown = [view.follower.picture for view in drawn_views()]
    return any(picture is not None and picture.pixels[..., 3].any() for picture in shown)


def _mouse(*words: Any) -> None:
    subprocess.run(["xdotool", *map(str, words)], check=True)


play(story)
