"""Splats that float: nearly no photo has them in its frame, or they touch no large part of the twin.

A surface that was learned from photos is made of splats that overlap. What hangs in the air in front of one camera, or
behind everything, belongs to a small island, or stands where few photos look.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mathutils.kdtree import KDTree
from numpy.typing import NDArray

from ...core.islands import island_sizes, islands
from ..axes import points_to_engine, read_camera
from .scene_cameras import PHOTO

#: Nearest neighbours that a splat may touch; one that only touches farther ones is linked by theirs.
_NEIGHBOURS = 8


def photos_of_splats(twin: Any, places: NDArray[np.float32], scene: Any) -> NDArray[np.intp] | None:
    """[N] how many of the photos whose cameras came with a twin have each splat's centre in their frame.

    None without cameras.

    Args:
        twin: `bpy` object; places: [N, 3] in its own axes; scene: `bpy` scene, whose frame the cameras have.
    """
    cameras = [child for child in twin.children if child.type == "CAMERA" and PHOTO in child]
    if not cameras:
        return None
    world = np.array(twin.matrix_world, np.float64)
    standing = places.astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    standing = points_to_engine(standing)
    counts = np.zeros(len(places), np.intp)
    for thing in cameras:
        camera = read_camera(thing, scene.render, thing.name)
        counts += camera.in_frame(standing)
    return counts


def sizes_of_islands(
    places: NDArray[np.float32], radii: NDArray[np.float32], gap: float, counted: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """[N] how many splats the island has that each splat belongs to.

    Args:
        places: [N, 3] centres; radii: [N] longest standard deviations, in the same units.
        gap: two splats touch where their centres are no farther apart than so many times their radii together.
        counted: [N] splats that make islands; others are none (0).
    """
    rows = np.flatnonzero(counted)
    sizes = np.zeros(len(places), np.intp)
    if not len(rows):
        return sizes
    tree = KDTree(len(rows))
    for number, place in enumerate(places[rows].tolist()):
        tree.insert(place, number)
    tree.balance()
    near = np.zeros((len(rows), _NEIGHBOURS + 1), np.intp)
    for number, place in enumerate(places[rows].tolist()):
        found = [index for _, index, _ in tree.find_n(place, _NEIGHBOURS + 1)]
        near[number] = found + [number] * (_NEIGHBOURS + 1 - len(found))
    pairs = np.stack([np.repeat(np.arange(len(rows)), near.shape[1]), near.reshape(-1)], axis=1)
    ends = rows[pairs]
    away = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    touching = away <= gap * (radii[ends[:, 0]] + radii[ends[:, 1]])
    sizes[rows] = island_sizes(islands(len(rows), pairs[touching]))
    return sizes
