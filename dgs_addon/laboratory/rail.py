"""Camera paths, as the engine's cameras. Needs numpy only.

Paths are laid out in Blender's world (z up, metres) and converted in one place, `axes`.
"""

from __future__ import annotations

import math
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
#: Radius of a patch: as far as a person moves a camera without walking.
PATCH_REACH = np.radians(20.0)
#: Focal length as a share of the frame's width; inside a room it is shorter.
FOCAL_SHARE, INSIDE_FOCAL_SHARE = 1.2, 0.7
#: Width and height (m) that forward-facing cameras are spread over: a fifth of the distance to every side.
FRONT_SIZE = np.array([0.28, 0.16])
#: Steps that spread points evenly over a square however many there are (Roberts' R2 sequence).
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])
#: Distance from the middle and way up and down (m) of cameras inside a scene of the ball's size.
INSIDE_RADIUS, INSIDE_RISE = 0.0575, 0.012
#: Side (m) of the square that a drone flies over, and how far ahead it looks, as a share of its height.
DRONE_SIDE, DRONE_AHEAD = 0.70, 0.3


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


def front(views: int) -> NDArray[np.float64]:
    """Positions evenly over an upright rectangle before the object, [views, 3], in an order that jumps."""
    share = (0.5 + (np.arange(views)[:, None] + 1) * _EVEN) % 1.0
    across, up = (FRONT_SIZE * (share - 0.5)).T
    return np.stack([across, np.full(views, -DISTANCE), up], -1) + TARGET


def patch(views: int) -> NDArray[np.float64]:
    """Positions spread evenly over a round patch in front of the object, [views, 3]; the first is in its middle."""
    reach = PATCH_REACH * np.sqrt((np.arange(views) + 0.5) / views)
    turn = np.arange(views) * np.pi * (3 - np.sqrt(5))
    aside, up = reach * np.cos(turn), reach * np.sin(turn)
    elevation = ELEVATION + up
    return TARGET + DISTANCE * _on_sphere(aside / np.cos(elevation) - np.pi / 2, elevation)


def inside(views: int) -> NDArray[np.float64]:
    """Positions on two turns around the middle of a room, [views, 3], up and down by `INSIDE_RISE`."""
    angle = np.arange(views) * (4 * np.pi / views)
    rise = INSIDE_RISE * np.sin(3 * angle)
    return np.stack([INSIDE_RADIUS * np.cos(angle), INSIDE_RADIUS * np.sin(angle), rise], -1) + TARGET


def drone(views: int) -> NDArray[np.float64]:
    """Positions on rows flown to and fro above the scene, [views, 3].

    The first is in the middle of a row: it is held out by default, and what a corner shows no other photo shows.
    """
    rows, row, flown = _rows(views)
    along = (flown + 0.5) * rows / views - row - 0.5
    across = (row + 0.5) / rows - 0.5
    return np.stack([_heading(row) * along * DRONE_SIDE, across * DRONE_SIDE, np.full(views, DISTANCE)], -1) + TARGET


PATHS: dict[str, Callable[[int], NDArray[np.float64]]] = {
    "rail": rail,
    "orbit": orbit,
    "dome": dome,
    "spiral": spiral,
    "front": front,
    "patch": patch,
    "inside": inside,
    "drone": drone,
}


def names(views: int) -> list[str]:
    """view_000.png ..."""
    digits = max(3, len(str(views - 1)))
    return [f"view_{index:0{digits}d}.png" for index in range(views)]


def cameras(
    path: str,
    views: int,
    width: int,
    height: int,
    target: NDArray[np.float64] = TARGET,
    size: float = 1.0,
    ground: float = -math.inf,
) -> list[Camera]:
    """One camera per view, all looking at the object.

    Args:
        path: one of `PATHS`; `front`, `inside` and `drone` look at more than the object.
        target: [3] middle of the object in Blender's world, metres.
        size: how many times larger than the ball the object is; distances grow with it.
        ground: metres; places that would be under it are as high above it.
    """
    around = PATHS[path](views)
    places, aims = (target + size * (points - TARGET) for points in (around, _aims(path, around)))
    if math.isfinite(ground):
        places[:, 2] = ground + np.abs(places[:, 2] - ground)
    lens = 36.0 * (INSIDE_FOCAL_SHARE if path == "inside" else FOCAL_SHARE)
    return [
        camera_to_engine(BlenderCamera(matrix_world=_look_at(place, aim), lens=lens), width, height, name)
        for place, aim, name in zip(places, aims, names(views), strict=True)
    ]


def _aims(path: str, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """[views, 3] what the cameras of a path look at: the object, unless they are inside or above it."""
    views = len(places)
    if path == "inside":  # first over the middle to the other side, then to the wall that is near
        outwards = (places - TARGET) * [1.0, 1.0, 0.0]
        way = np.where(np.arange(views)[:, None] < views / 2, -1.0, 3.0)
        return np.asarray(TARGET + way * outwards)
    if path == "drone":
        ahead = np.zeros_like(places)
        ahead[:, 0] = DRONE_AHEAD * DISTANCE * _heading(_rows(views)[1])
        return np.asarray(places * [1.0, 1.0, 0.0] + TARGET * [0.0, 0.0, 1.0] + ahead)
    return np.broadcast_to(TARGET, places.shape)


def _rows(views: int) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """How many rows a drone flies; of each view its row, and its number along the whole flight."""
    rows = max(1, round(np.sqrt(0.75 * views)))
    flown = np.roll(np.arange(views), -(max(views // rows, 1) - 1) // 2)
    return rows, flown * rows // views, flown


def _heading(row: NDArray[np.int64]) -> NDArray[np.float64]:
    """1 where a row is flown along x, -1 where it is flown back."""
    return 1.0 - 2.0 * (row % 2)


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
