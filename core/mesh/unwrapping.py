"""A mesh cut into charts that lie flat and side by side in a square: UVs, by xatlas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DgsError, OutputError
from ..numbers import number
from ..triangles import Mesh
from .cleaning import face_areas

try:
    import xatlas
except ImportError:  # an engine of before there were textures: everything else goes without
    xatlas = None


@dataclass(frozen=True)
class UnwrappingSettings:
    """How a mesh is cut."""

    part: int = number(
        5000,
        "faces",
        "that are cut at a time: the time grows with their square, and a part's border is a seam",
        "orrery, 30,000 faces: 5 s of a core whole, 1.0 s in parts; 3434 and 3617 charts",
    )
    padding: int = number(
        3, "texels", "between charts: a viewer mixes four texels, and half of that where it is far off"
    )
    filled: float = number(0.5, "share", "of the square that charts are to fill: what is left goes to the padding")


SETTINGS = UnwrappingSettings()


@dataclass(frozen=True)
class Charts:
    """Where the faces of a mesh are in a texture.

    Attributes:
        places, vertices, faces: as of `Texture`.
        count: of charts.
    """

    places: NDArray[np.float64] = field(repr=False)
    vertices: NDArray[np.int64] = field(repr=False)
    faces: NDArray[np.int64] = field(repr=False)
    count: int

    def areas(self) -> NDArray[np.float64]:
        """[M] shares of the square that the faces cover."""
        a, b, c = (self.places[self.faces[:, k]] for k in range(3))
        (ux, uy), (vx, vy) = (b - a).T, (c - a).T
        return np.asarray(np.abs(ux * vy - uy * vx) / 2)


def check_unwrapping() -> None:
    """Raises OutputError where the package that cuts meshes is not there; better before a mesh is made than after."""
    if xatlas is None:
        raise OutputError(
            "Textures need the package 'xatlas', which the engine's Python does not have",
            "Install the engine again, or leave the texture out",
        )


def unwrapped(mesh: Mesh, size: int, settings: UnwrappingSettings = SETTINGS) -> Charts:
    """Cuts a mesh into charts for a texture of `size` x `size` texels.

    Raises:
        OutputError: the package is not there. DgsError: there is nothing to cut.
    """
    check_unwrapping()
    areas = face_areas(mesh)
    if size < 1 or not len(areas) or not areas.sum() > 0:
        raise DgsError("A texture needs faces and texels", "Ask for a larger texture, or for none")
    # faces of about one unit each: below some size xatlas takes them for points
    unit = float(np.sqrt(areas.mean()))
    parts, atlas = _parts(mesh, settings.part), xatlas.Atlas()
    normals = mesh.normals().astype(np.float32)
    corners = [np.unique(mesh.faces[part], return_inverse=True) for part in parts]
    for used, index in corners:
        places = ((mesh.vertices[used] - mesh.vertices[used[0]]) / unit).astype(np.float32)
        atlas.add_mesh(places, index.reshape(-1, 3).astype(np.uint32), normals[used])
    atlas.generate(xatlas.ChartOptions(), _packing(size, float(areas.sum()) / unit**2, settings))
    return _joined(atlas, parts, [used for used, _ in corners])


def _packing(size: int, area: float, settings: UnwrappingSettings) -> Any:
    options = xatlas.PackOptions()
    options.texels_per_unit = float(size * np.sqrt(settings.filled / area))
    options.padding = settings.padding
    return options


def _parts(mesh: Mesh, most: int) -> list[NDArray[np.int64]]:
    """Indices of faces that lie together, at most so many each: halved across the longest side again and again."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    waiting, done = [np.arange(len(middles))], []
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            done.append(part)
            continue
        axis = np.ptp(middles[part], axis=0).argmax()
        order = part[np.argsort(middles[part, axis], kind="stable")]
        waiting += [order[len(order) // 2 :], order[: len(order) // 2]]
    return done


def _joined(atlas: Any, parts: list[NDArray[np.int64]], corners: list[NDArray[np.int64]]) -> Charts:
    """All parts as one, scaled so that the longer side of what xatlas has packed is the square's."""
    places, vertices, faces = [], [], np.empty((sum(map(len, parts)), 3), np.int64)
    sides = np.array([atlas.width, atlas.height], np.float64)
    first = 0
    for index, (part, used) in enumerate(zip(parts, corners, strict=True)):
        origin, triangles, uvs = atlas[index]
        faces[part] = triangles.astype(np.int64) + first
        vertices.append(used[origin.astype(np.int64)])
        places.append(uvs.astype(np.float64) * sides / sides.max())
        first += len(origin)
    return Charts(np.concatenate(places).clip(0.0, 1.0), np.concatenate(vertices), faces, int(atlas.chart_count))
