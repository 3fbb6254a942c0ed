"""Cameras that could be taken next: on a rail, on an orbit, on a dome, or from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import FormatError
from ..formats.cameras import read_cameras
from ..numbers import number

CameraPath = Literal["rail", "orbit", "dome"]
CAMERA_PATHS: tuple[CameraPath, ...] = ("rail", "orbit", "dome")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CandidateSettings:
    """Where candidates stand."""

    rail_extension: float = number(0.25, "share of the rail's length", "how far a rail is offered beyond its ends")
    lowest_elevation: float = number(-10.0, "deg", "of a dome's cameras; tables are seldom seen from below")
    highest_elevation: float = number(75.0, "deg", "of a dome's cameras; straight down, 'upright' has no meaning")
    minimum_turn: float = number(
        0.05, "rad", "cameras that turn less do not show which way is up across their rows of px"
    )


DEFAULTS = CandidateSettings()


@dataclass(frozen=True)
class ViewingGeometry:
    """How the photos stand around the scene, in world units.

    Attributes:
        focus: [3] what they look at together.
        up: [3] unit vector.
        distance: median distance of the cameras from the focus.
        elevation: median elevation of the cameras, radians above the horizon.
    """

    focus: Floats
    up: Floats
    distance: float
    elevation: float


def viewing_geometry(cameras: Sequence[Camera]) -> ViewingGeometry:
    """The viewing geometry of a set of photos: the point nearest to all optical axes (least squares)."""
    centres = np.array([camera.centre for camera in cameras])
    axes = np.array([camera.rotation[2] for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # Parallel axes meet nowhere: a weak prior keeps the focus near the cameras' mean distance.
    prior = 1e-6 * len(cameras) * np.eye(3)
    middle = centres.mean(axis=0)
    meeting = (across @ centres[:, :, None])[:, :, 0].sum(axis=0) + prior @ middle
    focus = np.linalg.solve(across.sum(axis=0) + prior, meeting)
    up = _up(cameras)
    rays = centres - focus
    distances = np.linalg.norm(rays, axis=1)
    heights = np.arcsin(np.clip(rays @ up / np.maximum(distances, 1e-12), -1.0, 1.0))
    return ViewingGeometry(focus, up, float(np.median(distances)), float(np.median(heights)))


def _up(cameras: Sequence[Camera]) -> Floats:
    """Cameras that look down are tilted, but rarely rolled: up is across all their rows of px."""
    tilted = -np.array([camera.rotation[1] for camera in cameras]).mean(axis=0)
    _, sizes, axes = np.linalg.svd(np.array([camera.rotation[0] for camera in cameras]))
    if len(sizes) > 2 and sizes[1] > DEFAULTS.minimum_turn * sizes[0] and sizes[2] < 0.5 * sizes[1]:
        up = axes[2] * np.sign(axes[2] @ tilted)
    else:
        up = tilted
    return np.asarray(up / max(float(np.linalg.norm(up)), 1e-12))


def looking_at(like: Camera, name: str, centre: Floats, focus: Floats, up: Floats) -> Camera:
    """A camera at `centre` with the lens of `like` that looks at `focus`, upright."""
    forward = focus - centre
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(forward, np.array([1.0, 0.0, 0.0]) if abs(forward[0]) < 0.9 else np.array([0.0, 1.0, 0.0]))
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, like.width, like.height, like.fx, like.fy, like.cx, like.cy, rotation, -rotation @ centre)


def candidates(path: CameraPath, cameras: Sequence[Camera], count: int) -> list[Camera]:
    """`count` cameras on a camera path that fits how the photos were taken.

    Args:
        path: 'rail' (the photos' own line, a little longer), 'orbit' (a circle at their distance and
            elevation) or 'dome' (evenly over directions from 10 degrees below the horizon to 75 above).
        cameras: of the photos, world units.
    """
    geometry = viewing_geometry(cameras)
    if path == "rail":
        centres = _rail(np.array([camera.centre for camera in cameras]), count)
    else:
        right, forward = _horizon(geometry, cameras)
        if path == "orbit":
            angles = 2.0 * np.pi * np.arange(count) / count
            heights = np.full(count, geometry.elevation)
        else:  # the golden angle spreads evenly (Fibonacci's sphere)
            angles = np.arange(count) * np.pi * (3.0 - 5.0**0.5)
            low, high = np.sin(np.radians([DEFAULTS.lowest_elevation, DEFAULTS.highest_elevation]))
            heights = np.arcsin(low + (high - low) * (np.arange(count) + 0.5) / count)
        flat = np.cos(angles)[:, None] * forward + np.sin(angles)[:, None] * right
        rays = np.cos(heights)[:, None] * flat + np.sin(heights)[:, None] * geometry.up
        centres = geometry.focus + geometry.distance * rays
    return [
        looking_at(cameras[0], f"{path}_{index:03d}", centre, geometry.focus, geometry.up)
        for index, centre in enumerate(centres)
    ]


def candidates_from(file: Path) -> list[Camera]:
    """Cameras of a file or a folder with one, of every format that cameras have; lens distortion is left out.

    Raises:
        FormatError: no cameras are there.
    """
    try:
        return list(read_cameras(file).pinholes().values())
    except FormatError as error:
        raise FormatError(
            f"No candidate cameras: {error.what}", f"{error.way_out}, or one of {', '.join(CAMERA_PATHS)}"
        ) from error


def _horizon(geometry: ViewingGeometry, cameras: Sequence[Camera]) -> tuple[Floats, Floats]:
    """Two horizontal unit vectors: to the right, and from the focus towards the first camera."""
    ray = cameras[0].centre - geometry.focus
    forward = ray - (ray @ geometry.up) * geometry.up
    if np.linalg.norm(forward) < 1e-9:
        forward = cameras[0].rotation[0]
    forward = forward / np.linalg.norm(forward)
    return np.cross(geometry.up, forward), forward


def _rail(centres: Floats, count: int) -> Floats:
    middle = centres.mean(axis=0)
    direction = np.linalg.svd(centres - middle)[2][0]
    along = (centres - middle) @ direction
    low, high = float(along.min()), float(along.max())
    beyond = DEFAULTS.rail_extension * (high - low)
    return middle + np.linspace(low - beyond, high + beyond, count)[:, None] * direction
