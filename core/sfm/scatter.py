"""Points for cameras that came without any: spread over what the cameras look at together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import BY_DEFINITION, number
from ..photos.load import Photo
from ..reconstruction import Reconstruction
from ..views import SparsePoints


@dataclass(frozen=True)
class ScatteredPointSettings:
    """Of the points that stand in for those of structure from motion."""

    count: int = number(5000, "count", "points in all")
    nearest: float = number(0.6, "share of the scene's depth", "where the points of a photo begin")
    farthest: float = number(1.5, "share of the scene's depth", "where the points of a photo end")
    parallel_distance: float = number(
        3.0, "spread of the cameras", "distance of the scene where the optical axes are parallel"
    )
    parallel_prior: float = number(
        1e-3, "per camera", "weight of that guess: it decides only what the axes leave open", BY_DEFINITION
    )


SETTINGS = ScatteredPointSettings()


def scattered_points(
    cameras: Reconstruction, photos: list[Photo], seed: int = 0, settings: ScatteredPointSettings = SETTINGS
) -> SparsePoints:
    """Random points in the frusta, coloured by the photo that each was drawn from.

    The depth of the scene is taken from where the optical axes come closest to one another; where
    they run parallel, from the spread of the cameras.
    """
    given = list(cameras.cameras().values())
    by_name = {photo.name: photo for photo in photos}
    focus = closest_point(np.array([c.centre for c in given]), np.array([c.rotation[2] for c in given]), settings)
    count = settings.count
    noise = np.random.default_rng(seed)
    positions, colours = np.empty((count, 3)), np.empty((count, 3), np.uint8)
    for index in range(count):
        camera = given[index % len(given)]
        ahead = float((camera.rotation @ focus + camera.translation)[2])
        distance = float(np.linalg.norm(camera.centre - focus))
        depth = (ahead if ahead > 0.1 * distance else distance) * noise.uniform(settings.nearest, settings.farthest)
        u, v = noise.uniform(0, camera.width), noise.uniform(0, camera.height)
        local = depth * np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
        positions[index] = camera.rotation.T @ (local - camera.translation)
        pixels = by_name[camera.name].pixels
        value = pixels[min(int(v), pixels.shape[0] - 1), min(int(u), pixels.shape[1] - 1)]
        colours[index] = value if pixels.dtype == np.uint8 else value // 257
    return SparsePoints(positions, colours)


def closest_point(
    centres: NDArray[np.float64], axes: NDArray[np.float64], settings: ScatteredPointSettings = SETTINGS
) -> NDArray[np.float64]:
    """The point nearest to all optical axes, least squares; a spread ahead where they are parallel.

    Args:
        centres, axes: [V, 3] positions of the cameras, and the directions in which they look.
    """
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    matrix = across.sum(0)
    spread = float(np.sqrt(((centres - centres.mean(0)) ** 2).sum(1).mean())) or 1.0
    ahead = centres.mean(0) + settings.parallel_distance * spread * axes.mean(0)
    # A weak prior at a guess ahead decides what parallel axes leave open.
    prior = settings.parallel_prior * len(centres)
    target = np.einsum("nij,nj->i", across, centres) + prior * ahead
    return np.linalg.solve(matrix + prior * np.eye(3), target)
