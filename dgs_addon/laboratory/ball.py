"""The scene 'rugby-ball': a pebbled ball with painted lines on a richly textured table."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from . import table
from .lines import LINES
from .materials import leather
from .settings import OBJECT_INDEX
from .shape import ball_pose, shape_for
from .sky import add_sky
from .surface import ball_surface


def build(seed: int, width: int, alone: bool = False) -> None:
    """Empties Blender's file and builds the scene in it, in metres, for frames of `width` px; alone: no table."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _add_ball(scene, seed, width)
    if not alone:
        table.build(scene, seed)
    add_lights(scene)
    add_camera(scene)


def add_camera(scene: Any) -> None:
    """A sharp, still camera, through which everything is rendered."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.clip_start, camera.data.clip_end = 0.01, 100.0
    scene.collection.objects.link(camera)
    scene.camera = camera


def _add_ball(scene: Any, seed: int, width: int) -> None:
    surface = ball_surface(shape_for(width), seed)
    mesh = bpy.data.meshes.new("ball")
    count = len(surface.faces)
    mesh.vertices.add(len(surface.vertices))
    mesh.vertices.foreach_set("co", surface.vertices.ravel())
    mesh.loops.add(count * 4)
    mesh.loops.foreach_set("vertex_index", surface.faces.ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(count, dtype=np.int32) * 4)
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    for name, values in (("relief", surface.relief), ("tint", surface.tint)):
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", values)
    mesh.materials.append(leather(LINES))
    ball = bpy.data.objects.new("ball", mesh)
    # Blender reads a matrix column by column from a nested sequence.
    ball.matrix_world = ball_pose().T.tolist()
    ball.pass_index = OBJECT_INDEX
    scene.collection.objects.link(ball)


def add_lights(scene: Any) -> None:
    """The studio: a dim sky and three lamps."""
    add_sky(scene, "studio", (0.75, 0.82, 1.0), 0.35)
    for name, place, size, power in (
        ("key", (-0.9, -0.9, 1.3), 0.7, 26.0),
        ("fill", (1.3, -0.6, 1.1), 1.0, 9.0),
        ("rim", (0.2, 1.4, 1.2), 0.8, 14.0),
    ):
        light = bpy.data.lights.new(name, "AREA")
        light.energy, light.size = power, size
        lamp = bpy.data.objects.new(name, light)
        lamp.location = place
        lamp.rotation_euler = (-lamp.location).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
