"""Matches between the photos of two twins: each feature lies where its ray meets its own twin's surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..forward import low_pass_on_grid, sharp_depths
from ..mesh.surfaces import SURFACE
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..sfm.describe import find_features
from ..sfm.features import Features, matched
from ..sfm.settings import SfmSettings
from ..twin.opened import OpenedTwin
from ..views import View
from .evidence import Array
from .settings import ALIGNMENT


@dataclass(frozen=True)
class Sighting:
    """One photo's features on its twin's surface.

    Attributes:
        camera: of the undistorted photo, the twin's world; features: as found.
        at: [N, 2] px of the undistorted photo; points: [N, 3] the twin's world, NaN where no surface is.
    """

    camera: Camera
    features: Features
    at: Array = field(repr=False)
    points: Array = field(repr=False)


@dataclass(frozen=True)
class Matches:
    """Features of both twins' photos that look alike.

    Attributes:
        cameras: of the photos of both; photo: [2, M] index of each match's photo in both.
        at: [2, M, 2] px; points: [2, M, 3] each in its own world.
    """

    cameras: tuple[list[Camera], list[Camera]]
    photo: NDArray[np.int64]
    at: Array
    points: Array


def matches_between(first: OpenedTwin, second: OpenedTwin, threads: int, progress: Progress) -> Matches:
    """All matches between some photos of one twin and some of another that lie on both surfaces.

    Raises:
        CameraError: as of `find_features`. Cancelled: the user asked to stop.
    """
    sets = [_sightings(twin, threads, progress) for twin in (first, second)]
    photo, at, points = list[tuple[int, int]](), list[Array](), list[Array]()
    for i, one in enumerate(sets[0]):
        for j, other in enumerate(sets[1]):
            pairs = matched(one.features, other.features)
            both = np.stack([one.points[pairs[:, 0]], other.points[pairs[:, 1]]])
            good = np.isfinite(both).all(axis=(0, 2))
            photo += [(i, j)] * int(good.sum())
            at.append(np.stack([one.at[pairs[good, 0]], other.at[pairs[good, 1]]]))
            points.append(both[:, good])
    cameras = [sighting.camera for sighting in sets[0]], [sighting.camera for sighting in sets[1]]
    empty = [np.zeros((2, 0, 2))], [np.zeros((2, 0, 3))]
    return Matches(
        cameras,
        np.array(photo, np.int64).reshape(-1, 2).T,
        np.concatenate(at or empty[0], axis=1),
        np.concatenate(points or empty[1], axis=1),
    )


def _sightings(twin: OpenedTwin, threads: int, progress: Progress) -> list[Sighting]:
    views = twin.kept
    chosen = np.unique(np.linspace(0, len(views) - 1, min(len(views), ALIGNMENT.photos)).round().astype(int))
    by_name = {photo.name: photo for photo in twin.photos}
    photos = [by_name[views[index].name] for index in chosen]
    psf = twin.medium.psf
    kernel = None if psf is None or psf.is_identity else psf.kernel()
    progress.stage("features", len(photos))
    found: Mapping[str, Features] = find_features(photos, kernel, SfmSettings(threads=threads), progress)
    return [_on_surface(twin, views[index], found[views[index].name]) for index in chosen]


def _on_surface(twin: OpenedTwin, view: View, features: Features) -> Sighting:
    camera, scale = view.camera, twin.scale
    drawn = RasterSettings(low_pass=low_pass_on_grid(1))
    depths = sharp_depths(scale.to_unit(twin.gaussians), scale.camera_to_unit(camera), drawn, held=SURFACE.held)
    depth = np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan) * scale.size
    positions = features.positions.astype(float)
    lens = twin.reconstruction.lenses[view.name]
    rays = lens.from_pixels(positions) if len(positions) else np.zeros((0, 2))
    at = rays * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    column, row = np.floor(at).astype(int).T if len(at) else np.zeros((2, 0), int)
    inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    z = np.where(inside, depth[np.where(inside, row, 0), np.where(inside, column, 0)], np.nan)
    local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) * z[:, None]
    return Sighting(camera, features, at, (local - camera.translation) @ camera.rotation)
