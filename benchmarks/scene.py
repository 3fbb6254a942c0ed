"""The study's kind of scene: Gaussians as of a trained object on a table, from a seed."""

from __future__ import annotations

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.constants import SH_C0, SH_COEFFICIENTS
from dgs.core.gaussians import Gaussians
from scipy.spatial import cKDTree

#: The study's photos: a 635 mm rail around a ball on a table, 800 x 533 px.
SIZE = (800, 533)
FOCAL_PX = 1000.0


def camera(width: int, height: int, degrees: float = 0.0) -> Camera:
    """A camera on an arc around the object, `degrees` from the middle of the rail."""
    turn, tilt = np.deg2rad(degrees), np.deg2rad(25.0)
    centre = 3.0 * np.array([np.sin(turn) * np.cos(tilt), -np.sin(tilt), -np.cos(turn) * np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    # (a frame of another shape sees more or less above and below)
    alike = abs(height / width - SIZE[1] / SIZE[0]) < 0.01
    high = SIZE[1] if alike else round(SIZE[0] * height / width)
    middle = SIZE[0] / 2, high / 2
    full = Camera(f"{degrees:+.1f}", SIZE[0], high, FOCAL_PX, FOCAL_PX, *middle, rotation, -rotation @ centre)
    return full.resized(width, height)


def surface_points(count: int, random: np.random.Generator) -> np.ndarray:
    """Points [count, 3] on an ellipsoid and on the table below it, which fills the frame."""
    on_ball = int(0.55 * count)
    directions = random.normal(size=(on_ball, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ball = directions * [0.75, 0.5, 0.5]
    table = np.stack(
        [
            random.uniform(-3, 3, count - on_ball),
            np.full(count - on_ball, 0.5),
            random.uniform(-1.6, 5, count - on_ball),
        ],
        axis=1,
    )
    return np.concatenate([ball, table]) + random.normal(scale=0.004, size=(count, 3))


def gaussians(count: int, sh_degree: int = 1, seed: int = 0) -> Gaussians:
    """`count` Gaussians with the spread of sizes, opacities and shapes that training leaves.

    Scales follow the distance to the third neighbour; the third axis is flat, most opacities are
    high and a third of them faint, as in a trained twin.
    """
    random = np.random.default_rng(seed)
    means = surface_points(count, random)
    spacing = cKDTree(means).query(means, k=4, workers=1)[0][:, 3]
    scales = spacing[:, None] * np.exp(random.normal(-0.35, 0.45, (count, 3))) * [1.0, 1.0, 0.4]
    faint = random.random(count) < 0.35
    logits = np.where(faint, random.normal(-2.0, 1.0, count), random.normal(1.5, 1.5, count))
    colour = 0.5 + 0.3 * np.sin(means * 9.0) + random.normal(scale=0.05, size=(count, 3))
    sh = random.normal(scale=0.05, size=(count, SH_COEFFICIENTS[sh_degree], 3))
    sh[:, 0] = (colour - 0.5) / SH_C0
    arrays = (means, np.log(scales), random.normal(size=(count, 4)), logits, sh)
    return Gaussians(*(torch.tensor(array, dtype=torch.float32) for array in arrays))
