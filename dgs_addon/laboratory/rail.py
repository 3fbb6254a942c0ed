"""Camera paths, as the engine's cameras. Needs numpy only.

Paths are laid out in Blender's world (z up, metres) and converted in one place, `axes`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import BlenderCamera, camera_to_engine

#: What all cameras look at: the middle of the ball.
TARGET = np.array([0.0, 0.0, 0.080])
#: Viewing distance of the paper, metres.
DISTANCE = 0.635
#: The paper's straight rail of 420 mm: 2 atan(210 / 635) = 36.6 degrees.
RAIL_LENGTH = 0.420
#: Height of rail and orbit above the table, as seen from the ball: half-way up, so that its top and its side are seen.
ELEVATION = np.radians(30.0)
#: Turns of the spiral: neighbouring rounds overlap, as a person walking around the table would photograph.
SPIRAL_TURNS = 2.5
#: Focal length as a share of the frame's width.
FOCAL_SHARE = 1.2


def rail(views: int) -> NDArray[np.float64]:
    """Positions along a straight rail beside the table, [views, 3]."""
    along = np.linspace(-RAIL_LENGTH / 2, RAIL_LENGTH / 2, views) if views > 1 else np.zeros(1)
    back, up = DISTANCE * np.cos(ELEVATION), DISTANCE * np.sin(ELEVATION)
    return np.stack([along, np.full(views, -back), np.full(views, up)], -1) + TARGET


def orbit(views: int) -> NDArray[np.float64]:
    """Positions on a full circle around the ball, [views, 3]."""
    angle = np.arange(views) * (2 * np.pi / views) - np.pi / 2
    return TARGET + DISTANCE * _on_sphere(angle, np.full(views, ELEVATION))


def dome(views: int) -> NDArray[np.float64]:
    """Positions spread over the upper hemisphere between 15 and 80 degrees, [views, 3]."""
    low, high = np.sin(np.radians(15.0)), np.sin(np.radians(80.0))
    height = low + (high - low) * (np.arange(views) + 0.5) / views
    return TARGET + DISTANCE * _on_sphere(np.arange(views) * np.pi * (3 - np.sqrt(5)), np.arcsin(height))


def spiral(views: int) -> NDArray[np.float64]:
    """Positions on a spiral of `SPIRAL_TURNS` turns that climbs from 12 to 68 degrees, [views, 3]."""
    share = np.linspace(0.0, 1.0, views)
    return TARGET + DISTANCE * _on_sphere(share * SPIRAL_TURNS * 2 * np.pi - np.pi / 2, np.radians(12.0 + 56.0 * share))


PATHS: dict[str, Callable[[int], NDArray[np.float64]]] = {"rail": rail, "orbit": orbit, "dome": dome, "spiral": spiral}


def names(views: int) -> list[str]:
    """view_000.png ..."""
    digits = max(3, len(str(views - 1)))
    return [f"view_{index:0{digits}d}.png" for index in range(views)]


def cameras(
    path: str, views: int, width: int, height: int, target: NDArray[np.float64] = TARGET, size: float = 1.0
) -> list[Camera]:
    """One camera per view, all looking at the object.

    Args:
        path: one of `PATHS`.
        target: [3] middle of the object in Blender's world, metres.
        size: how many times larger than the ball the object is; distances grow with it.
    """
    places = target + size * (PATHS[path](views) - TARGET)
    return [
        camera_to_engine(
            BlenderCamera(matrix_world=_look_at(place, target), lens=36.0 * FOCAL_SHARE), width, height, name
        )
        for place, name in zip(places, names(views), strict=True)
    ]


def _on_sphere(azimuth: NDArray[np.float64], elevation: NDArray[np.float64]) -> NDArray[np.float64]:
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)


def _look_at(position: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Blender's camera-to-world matrix: -z towards the target, y as upright as it can be."""
    backwards = (position - target) / np.linalg.norm(position - target)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(backwards, right), backwards], axis=1)
    matrix[:3, 3] = position
    return matrix
