"""Things on a shelf before a wall, to be photographed from the front: layers of depth, wires, gloss."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from .. import ball, surfaces
from ..parts import add_copy, add_mesh, add_smooth, box, circle, leaf, lump, tube, turned
from ..sky import add_sky


def build(seed: int) -> None:
    """The wall is the plane y = 0.25; cameras stand at y < 0."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    generator = np.random.default_rng(seed)
    wall = add_mesh(
        scene,
        "wall",
        *box((0, 0, 0), (6.0, 5.0, 0.1)),
        surfaces.planks("bricks", (0.34, 0.16, 0.11), (0.60, 0.40, 0.30), (0.22, 0.075), 0.007),
    )
    wall.location, wall.rotation_euler = (0.0, 0.30, 1.0), (np.pi / 2, 0.0, 0.0)
    pine = surfaces.wood("pine", (0.30, 0.17, 0.07), (0.58, 0.38, 0.19), 16.0)
    for z in (0.35, 0.85, 1.35):
        add_mesh(scene, "board", *box((0, 0.08, z), (1.9, 0.34, 0.03)), pine)
        for x in (-0.8, 0.8):
            add_mesh(
                scene,
                "bracket",
                *box((x, 0.1, z - 0.06), (0.02, 0.3, 0.1)),
                surfaces.metal("iron", (0.25, 0.25, 0.27), 0.4),
            )
    _top(scene, generator)
    _middle(scene, generator)
    _below(scene)
    _before(scene, generator)
    _lights(scene)
    ball.add_camera(scene)


def _top(scene: Any, generator: np.random.Generator) -> None:
    """Pots with leaves that hang over the board."""
    green = surfaces.foliage("ivy", (0.03, 0.12, 0.03), (0.26, 0.44, 0.10), 70.0)
    blade = add_mesh(scene, "leaf", *leaf(0.13, 0.05, 0.9), green)
    for x, paint in ((-0.6, (0.55, 0.25, 0.12)), (0.1, (0.15, 0.25, 0.35)), (0.7, (0.6, 0.55, 0.45))):
        clay = surfaces.speckled("pot", surfaces.dimmed(paint, 0.5), paint, 30.0, 0.5)
        pot = [(0.0, 0.0), (0.07, 0.0), (0.1, 0.13), (0.11, 0.16), (0.095, 0.16), (0.0, 0.12)]
        add_smooth(scene, "pot", turned(pot, 32, (x, 0.06, 1.365)), clay)
        for index in range(34):
            angle, out = index * 2.4, generator.uniform(0.02, 0.16)
            low = generator.uniform(-0.28, 0.14) if np.sin(angle) < 0.2 else generator.uniform(0.0, 0.14)
            place = (x + out * np.cos(angle), 0.06 + out * np.sin(angle) - 0.06 * (low < -0.02), 1.53 + low)
            add_copy(
                scene, blade, place, (generator.uniform(-0.4, 0.9), 0.0, angle - np.pi / 2), generator.uniform(0.6, 1.0)
            )
    bpy.data.objects.remove(blade)


def _middle(scene: Any, generator: np.random.Generator) -> None:
    """Books, and a bust before them."""
    covers = [surfaces.patchwork(f"cover {index}", 22.0 + 15.0 * index, 0.4) for index in range(3)] + [
        surfaces.speckled(f"cloth {index}", surfaces.dimmed(colour, 0.4), colour, 50.0)
        for index, colour in enumerate(((0.6, 0.08, 0.05), (0.07, 0.18, 0.42), (0.65, 0.55, 0.15), (0.75, 0.72, 0.66)))
    ]
    x = -0.85
    while x < 0.25:
        wide, high = generator.uniform(0.02, 0.06), generator.uniform(0.22, 0.38)
        cover = covers[int(generator.integers(len(covers)))]
        book = add_mesh(scene, "book", *box((0, 0, high / 2), (wide, 0.2, high)), cover)
        book.location = (x + wide / 2, 0.12, 0.865)
        x += wide + 0.002
    bpy.ops.mesh.primitive_monkey_add(size=0.26, location=(0.5, 0.02, 1.0), rotation=(0.0, 0.0, -0.25))
    bust = bpy.context.object
    bust.data.materials.append(surfaces.metal("bronze", (0.55, 0.33, 0.14), 0.25))
    bust.data.shade_smooth()
    half = np.linspace(-np.pi / 2, np.pi / 2, 33)
    globe = add_smooth(
        scene,
        "globe",
        turned([(0.09 * np.cos(a), 0.09 * np.sin(a)) for a in half]),
        surfaces.patchwork("globe", 18.0, 0.12),
    )
    globe.location = (0.78, -0.02, 0.99)
    brass = surfaces.metal("brass", (0.80, 0.55, 0.22), 0.25)
    add_smooth(
        scene,
        "hoop",
        tube(circle(0.1) @ np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]]) + [0.78, -0.02, 0.99], 0.004, closed=True),
        brass,
    )


def _below(scene: Any) -> None:
    """Bottles, a cup, fruit in a basket of wire."""
    for index, (x, colour) in enumerate(
        ((-0.8, (0.02, 0.10, 0.03)), (-0.68, (0.20, 0.05, 0.02)), (-0.56, (0.04, 0.08, 0.22)))
    ):
        glaze = surfaces.speckled(f"bottle {index}", colour, surfaces.dimmed(colour, 2.5), 14.0, 0.06)
        bottle = [
            (0.0, 0.0),
            (0.045, 0.0),
            (0.047, 0.02),
            (0.047, 0.17),
            (0.02, 0.24),
            (0.016, 0.33),
            (0.02, 0.34),
            (0.0, 0.34),
        ]
        add_smooth(scene, "bottle", turned(bottle, 36, (x, 0.02 + 0.03 * index, 0.365)), glaze)
        label = add_smooth(
            scene,
            "label",
            turned([(0.0475, 0.06), (0.0475, 0.14)], 36, (0.0, 0.0, 0.0)),
            surfaces.patchwork(f"label {index}", 60.0),
        )
        label.location = (x, 0.02 + 0.03 * index, 0.365)
    wire = surfaces.metal("wire", (0.6, 0.6, 0.62), 0.25)
    middle = np.array([0.05, 0.02, 0.37])
    for height, radius in ((0.0, 0.13), (0.05, 0.16), (0.10, 0.19), (0.15, 0.22)):
        add_smooth(scene, "wire", tube(circle(radius) + middle + [0, 0, height], 0.0025, closed=True), wire)
    for angle in np.arange(30) * (2 * np.pi / 30):
        ends = [(r * np.cos(angle), r * np.sin(angle), h) for r, h in ((0.13, 0.0), (0.22, 0.15))]
        add_smooth(scene, "wire", tube(np.linspace(ends[0], ends[1], 5) + middle, 0.002), wire)
    fruit = (
        ((0.75, 0.35, 0.03), (0.9, 0.55, 0.1)),
        ((0.45, 0.03, 0.02), (0.75, 0.2, 0.06)),
        ((0.3, 0.42, 0.05), (0.6, 0.65, 0.15)),
    )
    for index in range(9):
        mesh = lump(index, 0.055, 0.03, 4)
        mesh.materials.append(surfaces.speckled(f"fruit {index}", *fruit[index % 3], 40.0, 0.3))
        mesh.shade_smooth()
        ball_of = bpy.data.objects.new("fruit", mesh)
        angle, out = index * 2.4, 0.1 * (index < 6)
        ball_of.location = tuple(middle + [out * np.cos(angle), out * np.sin(angle), 0.055 + 0.08 * (index >= 6)])
        scene.collection.objects.link(ball_of)
    tin = surfaces.patchwork("tin", 45.0, 0.2)
    for place, size in (
        ((0.5, 0.05, 0.44), (0.2, 0.16, 0.15)),
        ((0.52, 0.05, 0.56), (0.15, 0.12, 0.09)),
        ((0.8, 0.03, 0.46), (0.12, 0.2, 0.19)),
    ):
        add_mesh(scene, "tin", *box(place, size), tin)


def _before(scene: Any, generator: np.random.Generator) -> None:
    """Nearest to the cameras: twigs and a wire with little lamps."""
    bark = surfaces.speckled("twig", (0.06, 0.04, 0.03), (0.28, 0.20, 0.14), 60.0)
    for start, lean in (((-0.9, -0.35, 0.0), 0.35), ((-0.8, -0.3, 0.0), -0.1), ((0.95, -0.35, 0.0), -0.3)):
        share = np.linspace(0.0, 1.0, 24)
        line = np.array(start) + np.stack([lean * share**1.5, 0.03 * np.sin(9 * share), 1.5 * share], -1)
        line[:, :2] += generator.normal(0.0, 0.004, (24, 2))
        add_smooth(scene, "twig", tube(line, 0.006), bark)
    share = np.linspace(0.0, 1.0, 40)
    line = np.stack([-1.1 + 2.2 * share, np.full(40, -0.2), 1.25 - 0.5 * np.sin(np.pi * share)], -1)
    add_smooth(scene, "cord", tube(line, 0.004), surfaces.speckled("cord", (0.02, 0.02, 0.02), (0.1, 0.1, 0.1), 50.0))
    paints = [
        surfaces.speckled(f"lamp {i}", surfaces.dimmed(colour, 0.5), colour, 40.0, 0.1)
        for i, colour in enumerate(((0.8, 0.1, 0.05), (0.8, 0.6, 0.1), (0.1, 0.4, 0.6)))
    ]
    half = np.linspace(-np.pi / 2, np.pi / 2, 13)
    for index in range(2, 39, 4):
        shape = turned([(0.022 * np.cos(a), 0.03 * np.sin(a)) for a in half], 20)
        add_smooth(scene, "lamp", shape, paints[index // 4 % 3]).location = tuple(line[index] - [0.0, 0.0, 0.034])


def _lights(scene: Any) -> None:
    add_sky(scene, "evening", (0.8, 0.85, 1.0), 0.4)
    for spot, size, power in (((-2.0, -2.5, 2.6), 1.2, 130.0), ((2.2, -2.0, 1.8), 1.0, 60.0)):
        light = bpy.data.lights.new("lamp", "AREA")
        light.energy, light.size = power, size
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = spot
        lamp.rotation_euler = (Vector((0.0, 0.2, 0.8)) - lamp.location).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
