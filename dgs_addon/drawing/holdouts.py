"""Meshes that hold twins out of final pictures: those that Blender calls a holdout, or whose collection is one.

Cycles writes no depth for them, so that no compositor could hold a twin out behind them: Descatter does it itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import points_to_engine
from .triangle_depths import triangle_depths


def is_holdout(thing: Any, layer: Any) -> bool:
    """Whether an object is one, by itself or by its collection in a view layer."""
    return bool(thing.is_holdout) or bool(thing.holdout_get(view_layer=layer))


def holdout_corners(depsgraph: Any) -> NDArray[np.float64]:
    """[T, 3, 3] corners of all holdouts' triangles, the engine's axes."""
    layer = depsgraph.view_layer
    parts = [np.zeros((0, 3, 3))]
    for instance in depsgraph.object_instances:
        thing = instance.object
        of = instance.parent if instance.is_instance else thing
        if thing.type != "MESH" or not (instance.is_instance or instance.show_self):
            continue
        if is_holdout(of.original, layer):
            parts.append(_corners(thing.data, np.array(instance.matrix_world, np.float64)))
    return np.concatenate(parts)


def held_out(corners: NDArray[np.float64], camera: Camera, near: float) -> NDArray[np.float32]:
    """[H, W] depths of the holdouts in a picture, rows upwards, infinite where there are none.

    Args:
        corners: of `holdout_corners`; near: what is nearer than this holds nothing out.
    """
    seen = corners @ camera.rotation.T + camera.translation
    return triangle_depths(seen, camera, near)[::-1].astype(np.float32)


def _corners(mesh: Any, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    mesh.calc_loop_triangles()
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", vertices)
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    world = vertices.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return points_to_engine(world)[faces.reshape(-1, 3)]
