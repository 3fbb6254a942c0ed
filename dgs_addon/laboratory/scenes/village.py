"""Houses, trees, fields, fences and wires, to be photographed from a drone."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import ball, surfaces
from ..parts import Shape, add_copy, add_mesh, add_smooth, box, lump, tube, turned
from ..sky import add_sky

#: Half the side of the ground, metres.
_HALF = 60.0


def build(seed: int) -> None:
    """The village; the ground is near z = 0."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    generator = np.random.default_rng(seed)
    _ground(scene)
    taken = _houses(scene, generator)
    _trees(scene, generator, taken)
    _small_things(scene, generator)
    _light(scene)
    ball.add_camera(scene)


def _height(x: Any, y: Any) -> Any:
    return 1.2 * np.sin(x / 17.0) * np.cos(y / 21.0) + 0.5 * np.sin(x / 7.0 + y / 9.0)


def _ground(scene: Any) -> None:
    side = 120
    at = np.linspace(-_HALF, _HALF, side)
    x, y = np.meshgrid(at, at, indexing="ij")
    vertices = np.stack([x, y, _height(x, y)], -1).reshape(-1, 3).tolist()
    faces: list[tuple[int, ...]] = [
        (i * side + j, (i + 1) * side + j, (i + 1) * side + j + 1, i * side + j + 1)
        for i in range(side - 1)
        for j in range(side - 1)
    ]
    graph = surfaces.Graph("ground")
    place = graph.node("ShaderNodeTexCoord").outputs["Object"]
    clouds = surfaces.noise(graph, place, 0.09, 9.0, 0.65)
    grass = graph.ramp(
        clouds,
        [(0.3, (0.05, 0.10, 0.02)), (0.5, (0.16, 0.22, 0.06)), (0.62, (0.30, 0.24, 0.12)), (0.75, (0.42, 0.36, 0.24))],
    )
    hue = graph.node("ShaderNodeSeparateColor")
    graph.put(hue.inputs[0], surfaces.cells(graph, place, 0.05))
    furrows = graph.ramp(surfaces.waves(graph, place, 0.5, 1.0), [(0.2, (0.16, 0.10, 0.05)), (0.7, (0.42, 0.34, 0.16))])
    field = graph.math("GREATER_THAN", hue.outputs[0], 0.55)
    fine = surfaces.noise(graph, place, 3.0, 5.0, 0.8)
    colour = graph.mix(graph.math("MULTIPLY", field, 0.8), grass, furrows)
    colour = graph.mix(0.7, colour, graph.ramp(fine, [(0.3, (0.3,) * 3), (0.7, (1.0,) * 3)]), "MULTIPLY")
    add_smooth(scene, "ground", (vertices, faces), surfaces.finished(graph, colour, 0.95))
    road = surfaces.speckled("road", (0.13, 0.12, 0.11), (0.30, 0.28, 0.26), 0.7, 0.9)
    line = np.linspace(-_HALF, _HALF, 90)
    for way in (np.stack([line, 6 * np.sin(line / 18)], -1), np.stack([4 + 5 * np.sin(line / 15), line], -1)):
        across = np.gradient(way, axis=0)[:, ::-1] * [-1.0, 1.0]
        across *= 1.8 / np.linalg.norm(across, axis=1, keepdims=True)
        sides = [np.c_[edge, _height(*edge.T) + 0.12] for edge in (way - across, way + across)]
        points = np.stack(sides, 1).reshape(-1, 3).tolist()
        add_smooth(
            scene, "road", (points, [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(len(line) - 1)]), road
        )


def _gable(size: tuple[float, float], low: float, high: float) -> tuple[Shape, Shape]:
    """Walls with gables, and two slopes that stand out over them."""
    x, y = size[0] / 2, size[1] / 2
    walls = [
        (-x, -y, -1.5),
        (x, -y, -1.5),
        (x, y, -1.5),
        (-x, y, -1.5),
        (-x, -y, low),
        (x, -y, low),
        (x, y, low),
        (-x, y, low),
        (-x, 0, high),
        (x, 0, high),
    ]
    faces: list[tuple[int, ...]] = [(0, 1, 5, 4), (2, 3, 7, 6), (1, 2, 6, 9, 5), (3, 0, 4, 8, 7)]
    out, fall = 0.5, (high - low) / y * 0.5
    roof = [(s * (x + out), t * (y + out), low - fall) for t in (-1, 1) for s in (-1, 1)] + [
        (s * (x + out), 0.0, high + 0.08) for s in (-1, 1)
    ]
    return (walls, faces), (roof, [(0, 1, 5, 4), (3, 2, 4, 5)])


def _houses(scene: Any, generator: np.random.Generator) -> list[tuple[float, float]]:
    tiles = [
        surfaces.planks(f"tiles {i}", dark, light, (0.45, 0.3), 0.03)
        for i, (dark, light) in enumerate(
            (
                ((0.30, 0.08, 0.04), (0.50, 0.18, 0.10)),
                ((0.10, 0.10, 0.12), (0.22, 0.22, 0.25)),
                ((0.38, 0.20, 0.10), (0.55, 0.36, 0.20)),
            )
        )
    ]
    walls = [
        surfaces.speckled(f"wall {i}", surfaces.dimmed(colour, 0.7), colour, 0.8, 0.8)
        for i, colour in enumerate(((0.75, 0.70, 0.60), (0.70, 0.45, 0.30), (0.55, 0.60, 0.65), (0.80, 0.72, 0.40)))
    ]
    dark = surfaces.metal("panes", (0.15, 0.18, 0.22), 0.1, 3.0)
    stone = surfaces.planks("chimney", (0.35, 0.15, 0.10), (0.5, 0.25, 0.17), (0.3, 0.1), 0.02)
    places: list[tuple[float, float]] = []
    for _ in range(400):
        x, y = generator.uniform(-48, 48, 2)
        near_road = abs(y - 6 * np.sin(x / 18)) < 7 or abs(x - 4 - 5 * np.sin(y / 15)) < 7
        if near_road or any(np.hypot(x - a, y - b) < 13 for a, b in places) or len(places) == 26:
            continue
        places.append((float(x), float(y)))
        size, low = tuple(generator.uniform((6, 5), (11, 7.5))), generator.uniform(2.6, 4.5)
        shape, roof = _gable(size, low, low + generator.uniform(1.8, 3.2))
        spin, spot = generator.uniform(0, np.pi), (x, y, float(_height(x, y)))
        chimney = box((size[0] / 4, 0.6, low + 2.0), (0.6, 0.6, 3.4))
        parts = [
            (shape, walls[int(generator.integers(4))]),
            (roof, tiles[int(generator.integers(3))]),
            (chimney, stone),
        ]
        for side in (-1, 1):
            for along in (-0.3, 0.0, 0.3):
                pane = box((along * size[0], side * size[1] / 2, 0.5 * low), (0.9, 0.06, 1.1))
                parts.append((pane, dark))
        for part, paint in parts:
            added = add_mesh(scene, "house", *part, paint)
            added.location, added.rotation_euler = spot, (0.0, 0.0, spin)
    return places


def _trees(scene: Any, generator: np.random.Generator, taken: list[tuple[float, float]]) -> None:
    bark = surfaces.speckled("bark", (0.06, 0.04, 0.02), (0.20, 0.14, 0.09), 3.0, 0.9)
    crowns = []
    for index, (dark, light) in enumerate(
        (
            ((0.02, 0.07, 0.01), (0.14, 0.25, 0.05)),
            ((0.05, 0.09, 0.02), (0.28, 0.30, 0.06)),
            ((0.12, 0.06, 0.02), (0.40, 0.20, 0.05)),
        )
    ):
        mesh = lump(10 + index, 1.0, 0.16, 5)
        mesh.materials.append(surfaces.speckled(f"crown {index}", dark, light, 2.6, 0.9))
        crown = bpy.data.objects.new("crown", mesh)
        scene.collection.objects.link(crown)
        crowns.append(crown)
    trunk = add_smooth(scene, "trunk", turned([(0.3, -1.0), (0.22, 1.0), (0.15, 4.0)], 10), bark)
    planted = 0
    for _ in range(900):
        x, y = generator.uniform(-55, 55, 2)
        near_road = abs(y - 6 * np.sin(x / 18)) < 3.5 or abs(x - 4 - 5 * np.sin(y / 15)) < 3.5
        if near_road or any(np.hypot(x - a, y - b) < 6.5 for a, b in taken) or planted == 120:
            continue
        planted += 1
        ground, size = float(_height(x, y)), generator.uniform(1.1, 2.6)
        add_copy(scene, trunk, (x, y, ground))
        for _ in range(3):
            shift = generator.normal(0.0, 0.45 * size, 3) * [1, 1, 0.5]
            crown = crowns[int(generator.integers(3))] if planted % 9 else crowns[2]
            spot = (x + shift[0], y + shift[1], ground + 3.2 + 0.6 * size + shift[2])
            add_copy(scene, crown, spot, (0.0, 0.0, generator.uniform(0, 6)), size * generator.uniform(0.6, 1.0))
    for first in (*crowns, trunk):
        bpy.data.objects.remove(first)


def _small_things(scene: Any, generator: np.random.Generator) -> None:
    """Cars, fences, and poles with wires."""
    paints = [
        surfaces.metal(f"car {i}", colour, 0.2, 2.0)
        for i, colour in enumerate(((0.6, 0.04, 0.03), (0.05, 0.12, 0.4), (0.75, 0.75, 0.75), (0.05, 0.05, 0.05)))
    ]
    for _ in range(16):
        x = generator.uniform(-50, 50)
        y = 6 * np.sin(x / 18) + generator.choice((-1.0, 1.0))
        spin, paint = np.arctan(np.cos(x / 18) / 3), paints[int(generator.integers(4))]
        for centre, size in (((0, 0, 0.7), (4.2, 1.7, 0.7)), ((-0.2, 0, 1.25), (2.2, 1.5, 0.6))):
            car = add_mesh(scene, "car", *box(centre, size), paint)
            car.location, car.rotation_euler = (x, y, float(_height(x, y))), (0.0, 0.0, spin)
    white = surfaces.speckled("fence", (0.55, 0.50, 0.42), (0.80, 0.78, 0.72), 3.0, 0.8)
    for y in (-22.0, 16.0, 34.0):
        for x in np.arange(-45, 45, 1.6):
            add_mesh(scene, "post", *box((x, y, float(_height(x, y)) + 0.5), (0.12, 0.12, 1.2)), white)
        line = np.linspace(-45, 45, 120)
        for lift in (0.45, 0.9):
            add_mesh(
                scene, "rail", *tube(np.stack([line, np.full(120, y), _height(line, y) + lift], -1), 0.05, 5), white
            )
    steel = surfaces.metal("pole", (0.35, 0.35, 0.36), 0.5, 3.0)
    xs = np.linspace(-54, 54, 7)
    tops = np.stack([xs, 6 * np.sin(xs / 18) + 3.4, _height(xs, 6 * np.sin(xs / 18) + 3.4) + 8.0], -1)
    for top in tops:
        add_mesh(scene, "pole", *tube(np.linspace(top - [0, 0, 9.0], top, 4), 0.14, 8), steel)
    for first, second in zip(tops[:-1], tops[1:], strict=True):
        share = np.linspace(0.0, 1.0, 16)[:, None]
        add_mesh(
            scene,
            "wire",
            *tube(first + share * (second - first) - 2.0 * share * (1 - share) * np.array([0, 0, 1]), 0.04, 5),
            steel,
        )


def _light(scene: Any) -> None:
    add_sky(scene, "sky", (0.45, 0.62, 1.0), 0.6)
    light = bpy.data.lights.new("sun", "SUN")
    light.energy, light.angle = 3.5, 0.02
    lamp = bpy.data.objects.new("sun", light)
    lamp.rotation_euler = (0.7, 0.25, 0.6)
    scene.collection.objects.link(lamp)
