"""The surface of one twin: the corners of a coarse mesh, and how they hang together."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..forward import low_pass_on_grid, sharp_depths
from ..mesh.build import MeshSettings, build_mesh
from ..mesh.surfaces import SURFACE
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..triangles import Mesh
from ..twin.opened import OpenedTwin
from .evidence import Array, Places
from .settings import REGIONS


@dataclass(frozen=True)
class Surface:
    """One twin's.

    Attributes:
        twin: whose it is; mesh: its corners are the places.
        edges: [E, 2]; area: [N] of each place, px-equivalents squared.
    """

    twin: OpenedTwin
    mesh: Mesh
    places: Places
    edges: NDArray[np.int64] = field(repr=False)
    area: Array = field(repr=False)

    @property
    def cameras(self) -> list[Camera]:
        """Of the photos that the twin was trained on."""
        return [view.camera for view in self.twin.kept]


def surface_of(twin: OpenedTwin, progress: Progress) -> Surface:
    """Raises DgsError where there is none, Cancelled where the user asked to stop."""
    cameras = [view.camera for view in twin.kept]
    asked = MeshSettings(REGIONS.detail, REGIONS.faces, matching="off")  # (whole: what has vanished is looked for, too)
    mesh = build_mesh(twin.gaussians, cameras, asked, progress).mesh
    away = [np.linalg.norm(mesh.vertices - camera.centre, axis=1) / camera.fx for camera in cameras]
    places, faces = Places(mesh.vertices, np.median(away, axis=0)), mesh.faces
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    a, b, c = (mesh.vertices[faces[:, k]] for k in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    area = sum(np.bincount(faces[:, k], third, len(mesh.vertices)) for k in range(3))
    return Surface(twin, mesh, places, np.unique(sides, axis=0), np.asarray(area / places.pixel**2))


def behind(twin: OpenedTwin, cameras: list[Camera], places: Array) -> Array:
    """[N] how much farther than places cameras see another twin's surface, in its units: the median; NaN if none does.

    Args:
        cameras: in the world of `twin`, as the places [N, 3] are.
    """
    drawn, gaussians = RasterSettings(low_pass=low_pass_on_grid(1)), twin.scale.to_unit(twin.gaussians)
    unit, found = twin.scale.points_to_unit(places), []
    for camera in cameras:
        camera = twin.scale.camera_to_unit(camera)
        depths = sharp_depths(gaussians, camera, drawn, held=SURFACE.held)
        depth = np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan)
        px, z = camera.projected(unit)
        inside, (u, v) = camera.in_frame(unit), np.floor(px).T
        at = np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)
        found.append(np.where(inside, depth[at] - z, np.nan))
    return _median(np.stack(found)) * twin.scale.size


def _median(values: Array) -> Array:
    """Over rows, without those that are NaN; NaN where all are."""
    count = np.isfinite(values).sum(axis=0)
    ordered = np.sort(values, axis=0)  # NaN come last
    middle = np.maximum(count - 1, 0) // 2
    return np.asarray(np.take_along_axis(ordered, middle[None], axis=0)[0])
