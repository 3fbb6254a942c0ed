"""A mesh of triangles. Needs numpy only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Texture:
    """A picture of a mesh's surface, and where each face is in it.

    Attributes:
        image: [S, S, 3] uint8 sRGB, its first row on top.
        places: [K, 2] float64, corners of the charts in it: 0 to 1 to the right, and 0 to 1 from its lower edge up.
        vertices: [K] int64, the corner of the mesh at each of them; one on a seam is at several.
        faces: [M, 3] int64 into `places`, in the order of the mesh's own.
    """

    image: NDArray[np.uint8] = field(repr=False)
    places: NDArray[np.float64] = field(repr=False)
    vertices: NDArray[np.int64] = field(repr=False)
    faces: NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True)
class Mesh:
    """Triangles with what is there at their corners.

    Attributes:
        vertices: [N, 3] float64, world units.
        faces: [M, 3] int64, counter-clockwise seen from outside (from where cameras are).
        colours: [N, 3] uint8 sRGB, or None.
        deviation: [N] float32, standard deviation of a corner's place along the normal, world units, or None.
        texture: more colours than corners have, or None.
    """

    vertices: NDArray[np.float64] = field(repr=False)
    faces: NDArray[np.int64] = field(repr=False)
    colours: NDArray[np.uint8] | None = field(default=None, repr=False)
    deviation: NDArray[np.float32] | None = field(default=None, repr=False)
    texture: Texture | None = field(default=None, repr=False)

    def with_faces(self, faces: NDArray[np.int64]) -> Mesh:
        """With other faces between the same corners, and no corner that none of them has. A texture is lost."""
        has = np.zeros(len(self.vertices), bool)
        has[faces] = True
        used = np.flatnonzero(has)
        place = np.full(len(self.vertices), -1, np.int64)
        place[used] = np.arange(len(used))
        colours = None if self.colours is None else self.colours[used]
        deviation = None if self.deviation is None else self.deviation[used]
        return Mesh(self.vertices[used], place[faces], colours, deviation)

    def normals(self) -> NDArray[np.float64]:
        """[N, 3] unit normals at the corners: means of their faces', by area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        total = np.zeros_like(self.vertices)
        for k in range(3):
            for axis in range(3):
                total[:, axis] += np.bincount(self.faces[:, k], across[:, axis], len(total))
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.asarray(total / np.maximum(length, 1e-30))

    def open_edges(self) -> NDArray[np.int64]:
        """[E, 2] edges that only one face has: borders of holes and of the whole."""
        edges = np.sort(np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]), axis=1)
        keys = edges[:, 0] * len(self.vertices) + edges[:, 1]
        found, index, counts = np.unique(keys, return_index=True, return_counts=True)
        return np.asarray(edges[index[counts == 1]])
