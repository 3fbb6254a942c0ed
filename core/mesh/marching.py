"""The mesh that lies where a field of signed distances is zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from ..triangles import Mesh
from .fusion_kernels import SIDE
from .volume import Volume

#: Blocks along each side of the part that marching cubes is given at a time: 64 voxels.
_PART = 8
#: Distances closer to zero than this (voxels) are moved away from it: no corner of the grid is a vertex itself.
_OFF_ZERO = 1e-3


def zero_surface(volume: Volume) -> Mesh:
    """Marching cubes (Lewiner et al. 2003, by scikit-image) where all corners of a cell were seen."""
    where = volume.places()
    parts = np.unique(volume.blocks // _PART, axis=0)
    vertices, faces, offset = [], [], 0
    for part in parts:
        found = _part(volume, where, part * _PART)
        if found is not None:
            vertices.append(found[0])
            faces.append(found[1] + offset)
            offset += len(found[0])
    if not vertices:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    return _welded(volume, np.concatenate(vertices), np.concatenate(faces))


def _part(
    volume: Volume, where: NDArray[np.int64], first: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Corners in voxels from the grid's first one, and faces, of 64 voxels each way from a block."""
    last = np.minimum(first + _PART + 1, where.shape)
    ids = where[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    side = np.array(ids.shape) * SIDE
    values, seen = np.ones(side, np.float32), np.zeros(side, bool)
    for place in np.argwhere(ids >= 0):
        block = ids[tuple(place)]
        at = tuple(slice(p * SIDE, (p + 1) * SIDE) for p in place)
        values[at], seen[at] = volume.values[block], volume.weights[block] > 0
    stop = tuple(slice(0, min(_PART * SIDE + 1, n)) for n in side)
    values, seen = values[stop], seen[stop]
    if min(values.shape) < 2:
        return None
    small = np.abs(values) < _OFF_ZERO
    values[small] = np.where(values[small] < 0, -_OFF_ZERO, _OFF_ZERO)
    cells = np.zeros_like(seen)
    whole = np.ones(tuple(n - 1 for n in seen.shape), bool)
    for corner in np.ndindex(2, 2, 2):
        whole &= seen[tuple(slice(c, n - 1 + c) for c, n in zip(corner, seen.shape, strict=True))]
    cells[1:, 1:, 1:] = whole  # (a cell is named by its last corner)
    if not whole.any() or not ((values[seen] < 0).any() and (values[seen] > 0).any()):
        return None
    try:
        vertices, faces, _, _ = marching_cubes(values, 0.0, mask=cells, gradient_direction="descent")
    except (ValueError, RuntimeError):  # no cell that was seen has a surface in it
        return None
    return vertices.astype(np.float64) + first * SIDE, faces.astype(np.int64)


def _welded(volume: Volume, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Mesh:
    """Parts become one: a corner on an edge of the grid is the same in all of them."""
    shape = (volume.blocks.max(axis=0).astype(np.int64) + 3) * SIDE
    base = np.floor(vertices + 1e-5).astype(np.int64)
    between = np.abs(vertices - np.round(vertices)) > 1e-5
    axis = np.where(between.sum(axis=1) == 1, between.argmax(axis=1), 3)
    base = np.where(between, base, np.round(vertices).astype(np.int64))
    keys = ((base[:, 0] * shape[1] + base[:, 1]) * shape[2] + base[:, 2]) * 4 + axis
    inside = axis == 3
    keys[inside] = -1 - np.arange(int(inside.sum()))  # within a cell: nobody else's
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    faces = index[faces]
    sound = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    world = volume.low + (vertices[first] + 0.5) * volume.voxel
    return Mesh(world, faces[sound]).with_faces(faces[sound])
