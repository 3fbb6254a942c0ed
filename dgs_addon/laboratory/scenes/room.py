"""A furnished room, to be photographed from inside all the way round."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import ball, surfaces
from ..parts import Point, add_copy, add_mesh, add_smooth, box, leaf, tube, turned

#: Half the room's length and depth, and its height, metres.
_X, _Y, _HIGH = 2.6, 2.1, 2.6


def build(seed: int) -> None:
    """The room: its floor is at z = 0, its middle at x = y = 0."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    generator = np.random.default_rng(seed)
    _walls(scene)
    _pictures(scene)
    _table(scene, generator)
    _books(scene, generator)
    _sofa(scene)
    _small_things(scene, generator)
    _lights(scene)
    ball.add_camera(scene)


def _walls(scene: Any) -> None:
    floor = surfaces.planks("floor", (0.26, 0.12, 0.05), (0.45, 0.25, 0.11), (0.9, 0.13))
    add_mesh(scene, "floor", *box((0, 0, -0.05), (2 * _X, 2 * _Y, 0.1)), floor)
    white = surfaces.speckled("ceiling", (0.70, 0.69, 0.66), (0.80, 0.79, 0.76), 5.0, 0.9)
    add_mesh(scene, "ceiling", *box((0, 0, _HIGH + 0.05), (2 * _X, 2 * _Y, 0.1)), white)
    bricks = surfaces.planks("bricks", (0.40, 0.14, 0.08), (0.58, 0.26, 0.16), (0.24, 0.08), 0.008)
    wall = add_mesh(scene, "brick wall", *box((0, 0, 0), (2 * _X, _HIGH, 0.1)), bricks)
    wall.location, wall.rotation_euler = (0.0, _Y + 0.05, _HIGH / 2), (np.pi / 2, 0.0, 0.0)
    paper = _wallpaper()
    add_mesh(scene, "papered wall", *box((0, -_Y - 0.05, _HIGH / 2), (2 * _X, 0.1, _HIGH)), paper)
    plaster = surfaces.speckled("plaster", (0.42, 0.47, 0.40), (0.62, 0.64, 0.54), 3.0, 0.8)
    for side in (-1, 1):
        add_mesh(scene, "plastered wall", *box((side * (_X + 0.05), 0, _HIGH / 2), (0.1, 2 * _Y, _HIGH)), plaster)
    oak = surfaces.wood("oak", (0.20, 0.10, 0.04), (0.42, 0.25, 0.12), 18.0)
    for side in (-1, 1):
        add_mesh(scene, "skirting", *box((0, side * (_Y - 0.01), 0.05), (2 * _X, 0.02, 0.1)), oak)
        add_mesh(scene, "skirting", *box((side * (_X - 0.01), 0, 0.05), (0.02, 2 * _Y, 0.1)), oak)
    add_mesh(scene, "door", *box((-_X + 0.02, -1.2, 1.0), (0.05, 0.85, 2.0)), oak)
    for height in (0.55, 1.45):
        add_mesh(
            scene,
            "panel",
            *box((-_X + 0.05, -1.2, height), (0.02, 0.6, 0.7)),
            surfaces.wood("elm", (0.3, 0.16, 0.07), (0.52, 0.33, 0.17), 30.0),
        )


def _wallpaper() -> Any:
    graph = surfaces.Graph("wallpaper")
    at = graph.node("ShaderNodeTexCoord").outputs["Object"]
    stripes = surfaces.waves(graph, at, 1.6, 0.0)
    ground = graph.ramp(stripes, [(0.45, (0.50, 0.40, 0.25)), (0.55, (0.30, 0.16, 0.14))], constant=True)
    flowers = graph.math("LESS_THAN", surfaces.cells(graph, at, 9.0, "Distance"), 0.28)
    hue = surfaces.cells(graph, at, 9.0)
    return surfaces.finished(graph, graph.mix(flowers, ground, graph.mix(0.4, hue, (0.75, 0.65, 0.4))), 0.7)


def _pictures(scene: Any) -> None:
    frame = surfaces.metal("gilt", (0.75, 0.50, 0.20), 0.35)
    for index, (x, z, wide, high) in enumerate(((-1.5, 1.5, 0.8, 0.6), (-0.2, 1.6, 0.5, 0.7), (1.0, 1.45, 0.9, 0.5))):
        add_mesh(scene, "frame", *box((x, _Y - 0.02, z), (wide + 0.08, 0.04, high + 0.08)), frame)
        painting = surfaces.patchwork(f"painting {index}", (6.0, 14.0, 9.0)[index])
        add_mesh(scene, "painting", *box((x, _Y - 0.042, z), (wide, 0.01, high)), painting)
    for index, (side, y, z, wide, high) in enumerate(
        ((-1, 0.3, 1.55, 0.9, 0.7), (-1, 1.3, 1.6, 0.5, 0.8), (1, -1.5, 1.4, 0.6, 0.8), (1, 1.2, 1.5, 0.8, 0.6))
    ):
        add_mesh(scene, "frame", *box((side * (_X - 0.015), y, z), (0.03, wide + 0.06, high + 0.06)), frame)
        poster = add_mesh(scene, "poster", *box((0, 0, 0), (0.01, wide, high)), _poster(index))
        poster.location = (side * (_X - 0.032), y, z)
    for index, x in enumerate((-2.0, -0.3, 0.45)):
        poster = add_mesh(scene, "poster", *box((0, 0, 0), (0.5, 0.02, 0.7)), _poster(4 + index))
        poster.location = (x, -_Y + 0.01, 1.6)
    bright = surfaces.shining("daylight", (0.30, 0.48, 0.75), (0.85, 0.88, 0.90), 1.5)
    add_mesh(scene, "window", *box((_X - 0.01, -0.2, 1.5), (0.02, 1.3, 1.1)), bright)
    paint = surfaces.speckled("paint", (0.70, 0.70, 0.68), (0.85, 0.85, 0.82), 20.0)
    for y in (-0.87, -0.2, 0.47):
        add_mesh(scene, "bar", *box((_X - 0.031, y, 1.5), (0.05, 0.05, 1.195)), paint)
    for z in (0.93, 1.5, 2.07):
        add_mesh(scene, "bar", *box((_X - 0.03, -0.2, z), (0.04, 1.4, 0.05)), paint)


def _poster(index: int) -> Any:
    """Clouds of colours with rings or stripes, another for each number."""
    graph = surfaces.Graph(f"poster {index}")
    at = surfaces.place(graph)
    clouds = surfaces.noise(graph, at, 3.0 + index, 6.0, 0.7)
    colours = [(0.05, 0.12, 0.30), (0.70, 0.35, 0.08), (0.75, 0.70, 0.55), (0.15, 0.35, 0.20), (0.45, 0.05, 0.08)]
    colours = colours[index % 5 :] + colours[: index % 5]
    ground = graph.ramp(clouds, [(0.30 + 0.1 * i, colour) for i, colour in enumerate(colours)])
    lines = surfaces.waves(graph, at, 4.0 + 2 * index, 3.0, "RINGS" if index % 2 else "BANDS")
    shade = graph.ramp(lines, [(0.3, (0.4,) * 3), (0.5, (1.0,) * 3)])
    return surfaces.finished(graph, graph.mix(0.7, ground, shade, "MULTIPLY"), 0.5)


def _table(scene: Any, generator: np.random.Generator) -> None:
    walnut = surfaces.wood("walnut", (0.10, 0.045, 0.02), (0.30, 0.15, 0.07), 22.0, 0.25)
    add_mesh(scene, "table top", *box((0.1, 0.1, 0.74), (1.1, 0.75, 0.035)), walnut)
    for x in (-0.38, 0.58):
        for y in (-0.2, 0.4):
            add_smooth(scene, "leg", turned([(0.03, 0.0), (0.022, 0.4), (0.035, 0.72)], 16, (x, y, 0.0)), walnut)
    rug = add_mesh(scene, "rug", *box((0, 0, 0), (2.2, 1.6, 0.012)), surfaces.patchwork("rug", 7.0, 0.95))
    rug.location = (0.1, 0.1, 0.006)
    steel = surfaces.metal("steel", (0.55, 0.55, 0.58), 0.3)
    seat = surfaces.speckled("seat", (0.35, 0.05, 0.04), (0.60, 0.14, 0.08), 25.0)
    for x, y, turn in ((-0.25, -0.62, 0.2), (0.5, -0.6, -0.15), (-0.2, 0.85, 3.0), (0.55, 0.85, 3.3)):
        _chair(scene, (x, y), turn, steel, seat)
    glaze = surfaces.patchwork("glaze", 25.0, 0.08)
    vase = [(0.0, 0.0), (0.05, 0.0), (0.09, 0.08), (0.07, 0.17), (0.03, 0.22), (0.045, 0.26), (0.038, 0.25), (0.0, 0.2)]
    add_smooth(scene, "vase", turned(vase, 40, (0.1, 0.15, 0.757)), glaze)
    green = surfaces.foliage("leaf", (0.04, 0.16, 0.03), (0.30, 0.42, 0.08), 40.0)
    blade = add_mesh(scene, "leaf", *leaf(0.34, 0.045, 1.1), green)
    for index in range(14):
        tilt, spin = generator.uniform(0.5, 1.3), index * 2.4
        add_copy(scene, blade, (0.1, 0.15, 1.0), (tilt, 0.0, spin), generator.uniform(0.7, 1.0))
    bpy.data.objects.remove(blade)
    cup = surfaces.speckled("china", (0.70, 0.68, 0.62), (0.85, 0.84, 0.80), 60.0, 0.1)
    for x, y in ((-0.2, 0.0), (0.42, 0.28), (0.4, -0.1)):
        shape = turned(
            [(0.0, 0.0), (0.03, 0.0), (0.045, 0.05), (0.05, 0.08), (0.046, 0.08), (0.0, 0.02)], 28, (x, y, 0.757)
        )
        add_smooth(scene, "cup", shape, cup)


def _chair(scene: Any, place: tuple[float, float], turn: float, frame: Any, seat: Any) -> None:
    """Of steel tube, 22 mm thick."""
    spin = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    middle = np.array([*place, 0.0])
    for side in (-0.19, 0.19):
        line = np.array([(side, 0.2, 0), (side, 0.2, 0.44), (side, -0.2, 0.44), (side, -0.2, 0)], np.float64)
        fine = np.concatenate([np.linspace(a, b, 8) for a, b in zip(line[:-1], line[1:], strict=True)])
        fine = fine[np.r_[True, np.linalg.norm(np.diff(fine, axis=0), axis=1) > 0]]
        add_smooth(scene, "tube", tube(fine @ spin.T + middle, 0.011), frame)
        back = np.linspace((side, -0.2, 0.44), (side, -0.28, 0.9), 8)
        add_smooth(scene, "tube", tube(back @ spin.T + middle, 0.011), frame)
    for shape in (box((0, 0, 0.46), (0.4, 0.42, 0.03)), box((0, -0.265, 0.8), (0.4, 0.025, 0.2))):
        points = np.array(shape[0]) @ spin.T + middle
        add_mesh(scene, "seat", points.tolist(), shape[1], seat)


def _books(scene: Any, generator: np.random.Generator) -> None:
    pine = surfaces.wood("pine", (0.45, 0.28, 0.12), (0.62, 0.43, 0.22), 14.0)
    left, right, back = 0.9, 2.3, -_Y + 0.15
    for z in (0.1, 0.5, 0.9, 1.3, 1.7):
        add_mesh(scene, "board", *box(((left + right) / 2, back, z), (right - left, 0.28, 0.025)), pine)
    for x in (left, right):
        add_mesh(scene, "side", *box((x, back, 0.87), (0.025, 0.28, 1.7)), pine)
    covers = [surfaces.patchwork(f"cover {index}", 30.0 + 12.0 * index) for index in range(3)] + [
        surfaces.speckled(f"cloth {index}", surfaces.dimmed(colour, 0.4), colour, 60.0)
        for index, colour in enumerate(((0.55, 0.07, 0.05), (0.06, 0.16, 0.38), (0.62, 0.50, 0.12), (0.08, 0.28, 0.14)))
    ]
    for z in (0.1125, 0.5125, 0.9125, 1.3125):
        x = left + 0.03
        while x < right - 0.08:
            wide, high, deep = (
                generator.uniform(0.018, 0.055),
                generator.uniform(0.2, 0.34),
                generator.uniform(0.15, 0.22),
            )
            cover = covers[int(generator.integers(len(covers)))]
            book = add_mesh(scene, "book", *box((0, 0, high / 2), (wide, deep, high)), cover)
            book.location = (x + wide / 2, back, z)
            x += wide + 0.002 + (generator.random() < 0.06) * 0.12


def _sofa(scene: Any) -> None:
    cloth = surfaces.patchwork("sofa cloth", 16.0, 0.9)
    for centre, size in (
        ((-1.9, 0.9, 0.22), (0.85, 1.7, 0.3)),
        ((-2.3, 0.9, 0.55), (0.2, 1.7, 0.6)),
        ((-1.9, 0.05, 0.4), (0.85, 0.16, 0.5)),
        ((-1.9, 1.75, 0.4), (0.85, 0.16, 0.5)),
    ):
        add_mesh(scene, "sofa", *box(centre, size), cloth)
    yellow = surfaces.speckled("cushion", (0.62, 0.40, 0.05), (0.85, 0.65, 0.20), 30.0)
    for y, spin in ((0.45, 0.3), (1.3, -0.4)):
        cushion = add_mesh(scene, "cushion", *box((0, 0, 0), (0.14, 0.42, 0.4)), yellow)
        cushion.location, cushion.rotation_euler = (-2.05, y, 0.55), (0.0, -0.3, spin)


def _small_things(scene: Any, generator: np.random.Generator) -> None:
    bpy.ops.mesh.primitive_monkey_add(size=0.42, location=(-0.9, -_Y + 0.35, 1.05), rotation=(0.0, 0.0, np.pi))
    bust = bpy.context.object
    bust.data.materials.append(surfaces.metal("bronze", (0.42, 0.24, 0.10), 0.28))
    bust.data.shade_smooth()
    marble = surfaces.speckled("marble", (0.30, 0.30, 0.32), (0.80, 0.78, 0.74), 6.0, 0.2)
    add_smooth(
        scene,
        "plinth",
        turned(
            [(0.2, 0.0), (0.2, 0.06), (0.15, 0.1), (0.15, 0.8), (0.2, 0.86), (0.0, 0.86)], 32, (-0.9, -_Y + 0.35, 0.0)
        ),
        marble,
    )
    wire = surfaces.metal("wire", (0.2, 0.2, 0.2), 0.4)
    add_smooth(scene, "cord", tube(np.linspace((0.1, 0.1, 1.95), (0.1, 0.1, _HIGH), 6), 0.006), wire)
    for index in range(10):  # a lampshade of wires
        angle = index * np.pi / 5
        share = np.linspace(0.0, 1.0, 8)
        radius = 0.04 + 0.2 * np.sqrt(share)
        line = np.stack([0.1 + radius * np.cos(angle), 0.1 + radius * np.sin(angle), 1.95 - 0.25 * share], -1)
        add_smooth(scene, "shade", tube(line, 0.006), wire)
    colours = [(0.6, 0.1, 0.05), (0.1, 0.3, 0.5), (0.7, 0.6, 0.1)]
    for index in range(12):
        colour = colours[index % 3]
        block = add_mesh(
            scene,
            "block",
            *box((0, 0, 0.04), (0.08, 0.08, 0.08)),
            surfaces.speckled(f"block {index}", surfaces.dimmed(colour, 0.5), colour, 40.0),
        )
        x, y = generator.uniform(0.9, 2.2), generator.uniform(0.7, 1.8)
        block.location, block.rotation_euler = (x, y, 0.0), (0.0, 0.0, generator.uniform(0.0, 3.0))


def _lights(scene: Any) -> None:
    world = bpy.data.worlds.new("night")
    scene.world = world
    lamps: tuple[tuple[Point, float, float], ...] = (
        ((-1.2, 0.0, _HIGH - 0.02), 1.4, 60.0),
        ((1.3, 0.3, _HIGH - 0.02), 1.4, 60.0),
    )
    for spot, size, power in lamps:
        light = bpy.data.lights.new("ceiling", "AREA")
        light.energy, light.size = power, size
        lamp = bpy.data.objects.new("ceiling", light)
        lamp.location = spot
        scene.collection.objects.link(lamp)
