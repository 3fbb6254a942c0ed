"""Veils: Gaussians close before a camera, where features show nothing and hardly a photo could object.

What stands right before one camera is in the frame of few others. Its photo may explain by it whatever the twin does
not explain yet, and no other photo contradicts; a view from beside then finds smoke before the object. (Barron et al.
2023, "Zip-NeRF", and others punish density near cameras; here the features say how far nothing is.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...camera import Camera
from ...numbers import number

#: What the numbers were chosen on, and what they were checked on.
_CHOSEN = "drinks, plain, three seeds: smoke before the cans in two of four held-out views is gone"
_CHECKED = "docs/studies/splatting.md: real and rendered sets of nine kinds, alike within their seeds"


@dataclass(frozen=True)
class VeilSettings:
    """What is taken for a veil."""

    empty: float = number(
        0.7,
        "of the depth of what a photo has nearest",
        "that nothing is expected in before its camera",
        _CHOSEN,
        _CHECKED,
    )
    photos: float = number(
        0.1,
        "share of the photos",
        "that have a veil in the frame at most (one photo always may): by more, what is not there is contradicted, and"
        " things without a feature, which may well be nearer than all features, are kept",
        _CHOSEN,
        _CHECKED,
    )
    outliers: float = number(
        1.0,
        "% of the points in a frame",
        "that structure from motion may have put too near",
        "no other value was tried",
    )
    points: int = number(20, "points in the frame", "fewer do not say what is nearest: nothing is taken for a veil")
    looked_at: int = number(20_000, "points", "of the scene that are looked at, evenly chosen")
    beside: float = number(0.1, "of the frame", "that splats reach into it from beside: it counts so much wider")


VEILS = VeilSettings()


def veils(
    means: NDArray[np.float32], cameras: Sequence[Camera], points: NDArray[np.float64], settings: VeilSettings = VEILS
) -> NDArray[np.bool_]:
    """Which Gaussians are nearer to a camera than anything that it shows, in the frame of hardly another.

    Args:
        means: [N, 3] centres; cameras: of the photos; points: [M, 3] of structure from motion, all in one world.

    Returns:
        [N] bool.
    """
    some = points[:: max(1, len(points) // settings.looked_at)]
    near = np.zeros(len(means), np.bool_)
    for camera in cameras:
        end = settings.empty * nearest_depth(camera, some, settings)
        depth = means @ camera.rotation[2].astype(np.float32) + np.float32(camera.translation[2])
        rows = np.flatnonzero((depth > 0) & (depth < end))
        near[rows[camera.in_frame(means[rows], settings.beside)]] = True
    rows = np.flatnonzero(near)
    frames = np.zeros(len(rows), int)
    for camera in cameras:
        frames += camera.in_frame(means[rows], settings.beside)
    near[rows] = frames <= math.ceil(settings.photos * len(cameras))
    return near


def nearest_depth(camera: Camera, points: NDArray[np.float64], settings: VeilSettings = VEILS) -> float:
    """Depth of the nearest of points [M, 3] in the frame but for outliers; 0 where too few are in it."""
    inside = points[camera.in_frame(points)]
    if len(inside) < settings.points:
        return 0.0
    return float(np.percentile(inside @ camera.rotation[2] + camera.translation[2], settings.outliers))
