"""Runs inside Blender with a window: a twin as the engine sees it, in all modes of a 3D view.

    blender --python drawing_story.py -- FOLDER

FOLDER/twin.ply is the twin; FOLDER/pictures gets the screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import bpy
from mathutils import Quaternion, Vector

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story
from stage import (
    FOLDER,
    addon,
    among_meshes,
    bare,
    drawn_views,
    imported_alone,
    play,
    seen,
    seen_from_the_front,
    settled,
    view_region,
)


def story(robot: Robot) -> Story:
    """All modes, one after the other."""
    scene = bpy.context.scene
    twin = imported_alone()
    yield 1.0
    space = robot.area().spaces.active
    bare(space)
    view = seen_from_the_front(space, twin)
    yield from settled("first")
    seen["solid"] = _evaluated(twin)
    yield from robot.picture("solid")
    yield from among_meshes(robot, view, settled)
    yield from _rendered(robot, scene, space)
    yield from _orbits(robot, space)
    yield from _killed(robot, view)
    yield from _other_engine(scene, space, twin)
    seen["saved"] = _saved(twin)


def _held_out(robot: Robot, view: Any) -> Story:
    """A holdout before the twin, and behind it, before a wall."""
    towards = view.view_rotation @ Vector((0.0, 0.0, 1.0))
    bpy.ops.mesh.primitive_cube_add(size=8.0)
    wall = bpy.context.object
    wall.location = view.view_location - 8.0 * towards
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    hole = bpy.context.object
    hole.is_holdout = True
    for name, way in (("behind", -2.5), ("front", 2.0)):
        hole.location = view.view_location + way * towards
        yield from settled(f"holdout {name}")
        yield from robot.picture(f"holdout-{name}")
    for thing in (wall, hole):
        bpy.data.objects.remove(thing)
    yield from settled("rendered alone")


def _rendered(robot: Robot, scene: Any, space: Any) -> Story:
    """Rendered mode; the camera of the view for the command line, and the time of a final picture."""
    scene.render.engine = "DESCATTER"
    space.shading.type = "RENDERED"
    yield from settled("rendered with meshes")
    yield from among_meshes(robot, space.region_3d, settled, "rendered-")
    yield from _held_out(robot, space.region_3d)
    yield from robot.picture("rendered")
    region, view = view_region(robot), space.region_3d
    seen["region"] = [region.x, region.y, region.width, region.height]
    camera, _ = addon("dgs_addon.drawing.view_camera").window_camera(
        view.view_matrix, view.window_matrix, region.width, region.height
    )
    addon("core.formats.transforms").write_transforms(FOLDER / "transforms.json", {"view.png": camera})
    scene.camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    scene.collection.objects.link(scene.camera)
    scene.camera.matrix_world = view.view_matrix.inverted()
    scene.render.resolution_x, scene.render.resolution_y = 800, 533
    scene.render.filepath, scene.render.dither_intensity = str(FOLDER / "final.png"), 0.0
    times = []
    for _ in range(2):
        began = time.perf_counter()
        bpy.ops.render.render(write_still=True)
        times.append(time.perf_counter() - began)
    seen["final"] = min(times)
    final = addon("dgs_addon.axes").read_camera(scene.camera, scene.render, "final.png")
    addon("core.formats.transforms").write_transforms(FOLDER / "final.json", {"final.png": final})


def _orbits(robot: Robot, space: Any) -> Story:
    """The view turns for 4 s: how often it is drawn, with which pictures, and when the full one is there."""
    for mode in ("RENDERED", "SOLID"):
        space.shading.type = mode
        yield from settled(mode)
        draws: list[float] = []
        pictures: list[tuple[float, Any]] = []
        handle = bpy.types.SpaceView3D.draw_handler_add(_drew, (draws, pictures), "WINDOW", "POST_PIXEL")
        began = time.perf_counter()
        while time.perf_counter() - began < 4.0:
            space.region_3d.view_rotation = Quaternion((0, 0, 1), 0.02) @ space.region_3d.view_rotation
            yield 0.005
        stopped = time.perf_counter()
        yield from settled(f"{mode} again")
        width = view_region(robot).width
        while pictures[-1][1].pixels.shape[1] != width and time.perf_counter() < stopped + 5:
            yield 0.01
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        moving = [picture.pixels.shape[1] for at, picture in pictures if at <= stopped]
        full = [at - stopped for at, picture in pictures if picture.pixels.shape[1] == width and at > stopped]
        seen[f"orbit {mode}"] = {
            "draws": len([at for at in draws if at <= stopped]) / 4.0,
            "pictures": len(moving) / 4.0,
            "widths": sorted(set(moving)),
            "full": min(full, default=None),
            "gap": max((b - a for a, b in zip(draws, draws[1:], strict=False)), default=None),
            "load": os.getloadavg()[0],
        }


def _drew(draws: list[float], pictures: list[tuple[float, Any]]) -> None:
    """Takes down when a view was drawn, and when with a new picture."""
    draws.append(time.perf_counter())
    for shown in drawn_views():
        if shown.follower.picture is not None and (not pictures or pictures[-1][1] is not shown.follower.picture):
            pictures.append((draws[-1], shown.follower.picture))


def _killed(robot: Robot, view: Any) -> Story:
    """The server is killed; the next movement brings another and the picture."""
    server = addon("dgs_addon.drawing.process").picture_server()
    starts = server.starts
    # The number is another one in the engine's own world of processes: it is found by what it runs.
    pid = next(
        int(entry.name)
        for entry in Path("/proc").iterdir()
        if entry.name.isdigit() and b"serve" in (entry / "cmdline").read_bytes().split(b"\0")
    )
    os.kill(pid, signal.SIGKILL)
    view.view_rotation = Quaternion((0, 0, 1), 0.3) @ view.view_rotation
    yield from settled("killed")
    seen["restarted"] = [server.starts - starts, server.error]
    yield from robot.picture("killed")


def _other_engine(scene: Any, space: Any, twin: Any) -> Story:
    """Cycles in Rendered mode gets instances, and Solid its outline again."""
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.cycles.preview_samples = 1
    space.shading.type = "RENDERED"
    yield 4.0
    seen["cycles"] = _evaluated(twin)
    space.shading.type = "SOLID"
    began = time.monotonic()
    while _evaluated(twin)[0] and time.monotonic() - began < 60.0:  # (a busy machine draws seldom)
        yield 0.5
    yield 0.5
    seen["solid again"] = _evaluated(twin)


def _saved(twin: Any) -> list[bool]:
    """Whether the twin is an outline in the saved file, and still in this one."""
    live = addon("dgs_addon.drawing.live")
    path = str(FOLDER / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path) as (_, into):
        into.objects = [twin.name]
    return [live._is_live(into.objects[0]), live._is_live(twin)]


def _evaluated(twin: Any) -> list[int]:
    """Instances of the twin in the viewport, and edges of its own."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mine = [i for i in depsgraph.object_instances if i.is_instance and i.parent and i.parent.original == twin]
    return [len(mine), len(twin.evaluated_get(depsgraph).data.edges)]


play(story)
