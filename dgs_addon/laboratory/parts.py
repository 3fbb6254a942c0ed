"""Shapes that the laboratory's scenes are built from: vertices and faces, and an object of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]
#: Vertices, and faces as indices of vertices.
Shape = tuple[list[Point], list[tuple[int, ...]]]


def add_mesh(scene: Any, name: str, vertices: Any, faces: Any, material: Any) -> Any:
    """An object of this mesh where its coordinates are."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.materials.append(material)
    added = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(added)
    return added


def add_smooth(scene: Any, name: str, shape: Shape, material: Any) -> Any:
    """As `add_mesh`, its normals interpolated."""
    added = add_mesh(scene, name, *shape, material)
    added.data.shade_smooth()
    return added


def add_copy(scene: Any, of: Any, place: Point, turn: Point = (0.0, 0.0, 0.0), size: float = 1.0) -> Any:
    """Another object of the same mesh. turn: Euler angles, radians."""
    copy = bpy.data.objects.new(of.name, of.data)
    copy.location, copy.rotation_euler, copy.scale = place, turn, (size, size, size)
    scene.collection.objects.link(copy)
    return copy


def box(centre: Any, size: Any) -> Shape:
    """A box whose sides are along the axes."""
    vertices: list[Point] = [
        (centre[0] + a * size[0] / 2, centre[1] + b * size[1] / 2, centre[2] + c * size[2] / 2)
        for a in (-1, 1)
        for b in (-1, 1)
        for c in (-1, 1)
    ]
    faces: list[tuple[int, ...]] = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, faces


def turned(profile: Sequence[tuple[float, float]], around: int = 48, centre: Point = (0.0, 0.0, 0.0)) -> Shape:
    """What a lathe makes: `profile` has radius and height, from below to above."""
    angle = np.arange(around) * (2 * np.pi / around)
    rings = [
        np.stack([r * np.cos(angle), r * np.sin(angle), np.full(around, z)], -1) + np.array(centre) for r, z in profile
    ]
    return _listed(np.stack(rings)), _walls(len(profile), around, closed=False)


def tube(line: Any, radius: float, around: int = 8, closed: bool = False) -> Shape:
    """A wire along the points of `line` ([N, 3]); closed: its end is its beginning."""
    points = np.asarray(line, dtype=np.float64)
    if closed:
        along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    else:
        along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # The direction that the line has least of is never along it.
    least = np.eye(3)[int(np.abs(along).max(axis=0).argmin())]
    across = np.cross(along, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across)
    angle = np.arange(around) * (2 * np.pi / around)
    rings = points[:, None] + radius * (
        np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * third[:, None]
    )
    return _listed(rings), _walls(len(points), around, closed)


def circle(radius: float, count: int = 96) -> NDArray[np.float64]:
    """[count, 3] points of a circle around the z axis, its start left out at its end."""
    angle = np.arange(count) * (2 * np.pi / count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)], -1)


def gear(teeth: int, radius: float, depth: float, height: float) -> Shape:
    """A flat wheel with teeth, from z = 0 to `height`."""
    steps = np.arange(4 * teeth)
    angle = steps * (2 * np.pi / (4 * teeth))
    rim = np.where(steps % 4 < 2, radius, radius - depth)
    ring = np.stack([rim * np.cos(angle), rim * np.sin(angle)], -1)
    count = len(steps)
    vertices = [(float(x), float(y), z) for z in (0.0, height) for x, y in ring]
    sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
    return vertices, [*sides, tuple(range(count))[::-1], tuple(range(count, 2 * count))]


def leaf(length: float, width: float, bend: float, steps: int = 8) -> Shape:
    """A blade along y from the origin that bends down by `bend` radians, folded along its middle."""
    share = np.linspace(0.0, 1.0, steps)
    angle = bend * share
    along = np.concatenate([[0.0], np.cumsum(np.cos(angle))[:-1]]) * length / (steps - 1)
    fall = -np.concatenate([[0.0], np.cumsum(np.sin(angle))[:-1]]) * length / (steps - 1)
    half = 0.5 * width * np.sin(np.pi * (0.03 + 0.97 * share) ** 0.7)
    rows = np.stack(
        [np.stack([side * half, along, fall + 0.3 * abs(side) * half], -1) for side in (-1.0, 0.0, 1.0)], axis=1
    )
    faces: list[tuple[int, ...]] = [
        (3 * i + j, 3 * i + j + 1, 3 * i + j + 4, 3 * i + j + 3) for i in range(steps - 1) for j in (0, 1)
    ]
    return _listed(rows), faces


def lump(seed: int, radius: float, roughness: float, level: int = 3) -> Any:
    """A mesh like a stone or a tree's crown: a ball whose surface goes in and out."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=level, radius=1.0)
    made = bpy.context.object
    mesh = made.data
    bpy.data.objects.remove(made)
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", flat)
    places = flat.reshape(-1, 3).astype(np.float64)
    generator = np.random.default_rng(seed)
    rise = np.zeros(len(places))
    for frequency in (2.0, 4.0, 8.0, 16.0):
        for wave in generator.normal(size=(4, 3)):
            rise += np.sin(places @ wave * frequency + generator.uniform(0, 2 * np.pi)) / frequency
    places *= radius * (1 + roughness * rise)[:, None]
    mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
    mesh.update()
    return mesh


def _listed(points: NDArray[np.float64]) -> list[Point]:
    return [(float(x), float(y), float(z)) for x, y, z in points.reshape(-1, 3)]


def _walls(rings: int, around: int, closed: bool) -> list[tuple[int, ...]]:
    faces: list[tuple[int, ...]] = []
    for ring in range(rings if closed else rings - 1):
        here, after = ring * around, (ring + 1) % rings * around
        faces += [(here + i, here + (i + 1) % around, after + (i + 1) % around, after + i) for i in range(around)]
    return faces
