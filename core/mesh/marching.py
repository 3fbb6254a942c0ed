"""The mesh that lies where a field of signed distances is zero."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from ..compiled import run, threads
from ..triangles import Mesh
from .cleaning import without_strays
from .cleaning_kernels import weld_faces
from .fusion_kernels import SIDE
from .marching_kernels import corner_keys, fill_part, find_cells
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
    # (scikit-image's part runs on one thread: another one fills what it is given next)
    with ThreadPoolExecutor(min(2, threads())) as pool:
        for found in pool.map(lambda part: _part(volume, where, part * _PART), parts):
            if found is not None:
                vertices.append(found[0])
                faces.append(found[1] + np.int32(offset))
                offset += len(found[0])
    if not vertices:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    return _welded(volume, np.concatenate(vertices), np.concatenate(faces))


def _part(
    volume: Volume, where: NDArray[np.int64], first: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int32]] | None:
    """Corners in voxels from the grid's first one, and faces, of 64 voxels each way from a block."""
    last = np.minimum(first + _PART + 1, where.shape)
    ids = where[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    side = np.minimum(np.array(ids.shape) * SIDE, _PART * SIDE + 1)
    values, sides, cells = np.empty(side, np.float32), np.empty(side, np.uint8), np.empty(side, bool)
    fill_part(0, len(values), ids, volume.values, volume.weights, np.float32(_OFF_ZERO), values, sides)
    if not find_cells(0, len(values), sides, cells):
        return None
    vertices, faces, _, _ = marching_cubes(values, 0.0, mask=cells, gradient_direction="descent")
    return vertices.astype(np.float64) + first * SIDE, faces


def _welded(volume: Volume, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Mesh:
    """Parts become one: a corner on an edge of the grid is the same in all of them."""
    shape = (volume.blocks.max(axis=0).astype(np.int64) + 3) * SIDE
    keys = np.empty(len(vertices), np.int64)
    run(corner_keys, len(vertices), vertices, shape, keys, grain=4096)
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    sound = np.empty((len(faces), 3), np.int64)
    sound = sound[: weld_faces(0, len(faces), faces, index, sound)]
    return without_strays(volume.low + (vertices[first] + 0.5) * volume.voxel, sound)
