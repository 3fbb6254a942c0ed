"""What is taken off a mesh: crumbs, and faces that say no more than their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from ..compiled import run
from ..numbers import number
from ..triangles import Mesh
from .cleaning_kernels import join_corners, keep_parts, mark_corners, renumber_corners, sum_areas


@dataclass(frozen=True)
class CleaningSettings:
    """What is taken off."""

    crumb: float = number(
        100.0, "voxels^2", "of area: a part that hangs together and is smaller is a crumb, not a surface"
    )


SETTINGS = CleaningSettings()


def without_crumbs(mesh: Mesh, voxel: float, settings: CleaningSettings = SETTINGS) -> Mesh:
    """Without parts that are smaller than any surface; the largest part stays."""
    if not len(mesh.faces):
        return mesh
    parents, areas = np.arange(len(mesh.vertices), dtype=np.int32), np.zeros(len(mesh.vertices))
    count = len(mesh.faces)
    join_corners(0, count, mesh.faces, parents)
    sum_areas(0, count, mesh.faces, mesh.vertices, parents, areas)
    least = min(settings.crumb * voxel**2, float(areas.max()))
    kept = np.empty((count, 3), np.int64)
    kept = kept[: keep_parts(0, count, mesh.faces, parents, areas, least, kept)]
    return without_strays(mesh.vertices, kept)


def without_strays(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Mesh:
    """A mesh without corners that no face has, as `Mesh.with_faces`; the faces are changed in place, so that millions
    of them take no more memory."""
    has, places = np.zeros(len(vertices), bool), np.empty(len(vertices), np.int64)
    run(mark_corners, len(faces), faces, has, grain=4096)
    used = np.flatnonzero(has)
    places[used] = np.arange(len(used))
    run(renumber_corners, len(faces), faces, places, grain=4096)
    return Mesh(vertices[used], faces)


def face_areas(mesh: Mesh) -> NDArray[np.float64]:
    """[M] areas of the faces."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def decimated(mesh: Mesh, faces: int) -> Mesh:
    """With about so many faces at most: edges whose loss changes the shape least collapse (Garland and Heckbert 1997).

    Colours and deviations are lost.
    """
    if len(mesh.faces) <= faces:
        return mesh
    middle = mesh.vertices.mean(axis=0)  # (the library computes in float32)
    share = 1.0 - faces / len(mesh.faces)
    places, triangles = fast_simplification.simplify(
        (mesh.vertices - middle).astype(np.float32), mesh.faces.astype(np.int32), share
    )
    return Mesh(places.astype(np.float64) + middle, triangles.astype(np.int64)).with_faces(triangles.astype(np.int64))
