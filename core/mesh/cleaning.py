"""What is taken off a mesh: crumbs, and faces that say no more than their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..numbers import number
from ..triangles import Mesh


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
    count = len(mesh.vertices)
    a, b = mesh.faces[:, [0, 1]].T, mesh.faces[:, [1, 2]].T
    rows, columns = np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]])
    _, part = connected_components(coo_matrix((np.ones(len(rows), bool), (rows, columns)), (count, count)), False)
    areas = np.bincount(part[mesh.faces[:, 0]], face_areas(mesh))
    kept = areas >= min(settings.crumb * voxel**2, float(areas.max()))
    return mesh.with_faces(mesh.faces[kept[part[mesh.faces[:, 0]]]])


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
