"""The pebbled surface of a rugby ball as plain arrays: true displacement, no bump map.

Needs numpy only. Object coordinates: x along the ball's long axis, metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class BallShape:
    """A prolate ellipsoid covered with pebbles. Lengths in metres.

    Attributes:
        half_length, radius: semi-axes along and across the long axis.
        pitch: mean distance between neighbouring pebbles.
        height: height of a pebble over the valley around it.
        around, along: number of vertices around the axis and from tip to tip.
    """

    half_length: float = 0.140
    radius: float = 0.095
    pitch: float = 0.0050
    height: float = 0.0009
    around: int = 1100
    along: int = 680


@dataclass(frozen=True)
class BallSurface:
    """Mesh of the ball.

    Attributes:
        vertices: [V, 3] float32, metres.
        faces: [F, 4] int32, counter-clockwise from outside.
        relief: [V] float32 in [0, 1], 0 in the valleys and 1 on top of the pebbles.
        tint: [V] float32 in [0, 1], one random value per pebble.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    relief: NDArray[np.float32]
    tint: NDArray[np.float32]


def ball_surface(shape: BallShape, seed: int) -> BallSurface:
    """The displaced mesh; the same seed gives the same ball."""
    generator = np.random.default_rng(seed)
    polar, azimuth, smooth = _grid(shape)
    centres = _pebble_centres(shape, generator)
    nearest, second, owner = _two_nearest(shape, polar, azimuth, smooth, centres)
    # The valley runs where two pebbles are equally far: second - nearest = 0.
    rise = np.clip((second - nearest) / (0.75 * shape.pitch), 0.0, 1.0)
    relief = 1.0 - (1.0 - rise) ** 2
    relief *= generator.uniform(0.65, 1.0, len(centres))[owner]
    normal = smooth / np.array([shape.half_length, shape.radius, shape.radius]) ** 2
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    vertices = smooth + normal * (shape.height * (relief - 1.0))[..., None]
    tint = generator.random(len(centres))[owner]
    return BallSurface(
        vertices=vertices.reshape(-1, 3).astype(np.float32),
        faces=_faces(shape),
        relief=relief.reshape(-1).astype(np.float32),
        tint=tint.reshape(-1).astype(np.float32),
    )


def _grid(shape: BallShape) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    # The tips stay open by a hair's breadth: quads must not degenerate.
    polar = np.linspace(0.004, np.pi - 0.004, shape.along)
    azimuth = np.arange(shape.around) * (2 * np.pi / shape.around)
    x = shape.half_length * np.cos(polar)[:, None] * np.ones_like(azimuth)
    ring = shape.radius * np.sin(polar)[:, None]
    return polar, azimuth, np.stack([x, ring * np.cos(azimuth), ring * np.sin(azimuth)], axis=-1)


def _faces(shape: BallShape) -> NDArray[np.int32]:
    row = np.arange(shape.along - 1)[:, None] * shape.around
    here = np.arange(shape.around)
    after = (here + 1) % shape.around
    corners = [row + here, row + shape.around + here, row + shape.around + after, row + after]
    return np.stack(np.broadcast_arrays(*corners), axis=-1).reshape(-1, 4).astype(np.int32)


def _pebble_centres(shape: BallShape, generator: np.random.Generator) -> NDArray[np.float64]:
    """Jittered golden-angle spiral, evenly dense per area: [P, 3]."""
    fine = np.linspace(0.0, np.pi, 4001)
    slope = np.hypot(shape.half_length * np.sin(fine), shape.radius * np.cos(fine))
    density = 2 * np.pi * shape.radius * np.sin(fine) * slope
    area = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
    count = int(area[-1] / (shape.pitch**2 * np.sqrt(3) / 2))
    polar = np.interp((np.arange(count) + 0.5) / count * area[-1], area, fine)
    azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))
    radius = shape.radius * np.sin(polar)
    points = np.stack([shape.half_length * np.cos(polar), radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=-1)
    points += generator.normal(0.0, 0.20 * shape.pitch, points.shape)
    axes = np.array([shape.half_length, shape.radius, shape.radius])
    return points / np.linalg.norm(points / axes, axis=-1, keepdims=True)


def _two_nearest(
    shape: BallShape,
    polar: NDArray[np.float64],
    azimuth: NDArray[np.float64],
    smooth: NDArray[np.float64],
    centres: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Distances to the nearest and second nearest pebble, and which the nearest is: [along, around]."""
    nearest = np.full(smooth.shape[:2], np.inf)
    second = np.full(smooth.shape[:2], np.inf)
    owner = np.zeros(smooth.shape[:2], dtype=np.int64)
    reach = 2.5 * shape.pitch
    row_step = polar[1] - polar[0]
    for index, centre in enumerate(centres):
        ring = np.hypot(centre[1], centre[2])
        angle = np.arctan2(ring / shape.radius, centre[0] / shape.half_length)
        rows_away = int(np.ceil(reach / shape.radius / row_step))
        middle = int(round((angle - polar[0]) / row_step))
        rows = slice(max(0, middle - rows_away), min(shape.along, middle + rows_away + 1))
        if ring > 2 * reach:
            width = int(np.ceil(np.arcsin(reach / (ring - reach)) / (azimuth[1] - azimuth[0])))
            start = int(round(np.arctan2(centre[2], centre[1]) / (azimuth[1] - azimuth[0])))
            columns = np.arange(start - width, start + width + 1) % shape.around
        else:
            columns = np.arange(shape.around)
        distance = np.linalg.norm(smooth[rows][:, columns] - centre, axis=-1)
        block = np.ix_(np.arange(rows.start, rows.stop), columns)
        best, runner_up = nearest[block], second[block]
        closer = distance < best
        second[block] = np.where(closer, best, np.minimum(runner_up, distance))
        nearest[block] = np.where(closer, distance, best)
        owner[block] = np.where(closer, index, owner[block])
    return nearest, second, owner
