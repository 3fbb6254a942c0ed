"""Closed-form scenes: a textured plane and a textured ball, ray by ray, with their true depth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dgs.core.lens import Lens
from dgs.core.photos.load import Background, Photo
from dgs.core.pose import Pose
from dgs.core.reconstruction import Figures, Reconstruction, no_points

RADIUS = 1.0
#: Of the plane behind the ball, z in the world.
BEHIND = 1.5


@dataclass(frozen=True)
class DrawnScene:
    """Photos, their cameras, and the depth of each px along the axis (inf where nothing is)."""

    photos: list[Photo]
    cameras: Reconstruction
    depths: list[np.ndarray]


def looking(centre: np.ndarray, at: np.ndarray) -> Pose:
    """A camera at `centre` that looks at a point, y down."""
    forward = (at - centre) / np.linalg.norm(at - centre)
    down = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pose(rotation, -rotation @ centre)


def texture(points: np.ndarray, seed: int, finest: float = 0.12) -> np.ndarray:
    """[N, 3] colours in [0, 1] of points [N, 3]: waves in all directions, the finest of so many world units."""
    noise = np.random.default_rng(seed)
    total = np.zeros((len(points), 3))
    for _ in range(40):
        direction = noise.normal(size=3)
        length = finest * 6 ** noise.uniform()
        wave = np.sin(points @ (direction / np.linalg.norm(direction)) * (2 * np.pi / length) + noise.uniform(0, 7))
        total += wave[:, None] * noise.uniform(0.4, 1.0, 3)
    return np.clip(0.5 + 0.09 * total, 0, 1)


def drawn(
    centres: np.ndarray,
    size: tuple[int, int] = (96, 72),
    focal: float = 100.0,
    ball: bool = True,
    plane: bool = True,
    plain: bool = False,
) -> DrawnScene:
    """Photos from `centres` [N, 3] towards the origin.

    Args:
        ball, plane: what is there; a px that shows neither is transparent.
        plain: the plane has no texture.
    """
    width, height = size
    lens = Lens("PINHOLE", width, height, (focal, focal, width / 2, height / 2))
    photos, poses, depths = [], {}, []
    for index, centre in enumerate(centres):
        pose = looking(np.asarray(centre, float), np.zeros(3))
        colours, depth = _photo(pose, lens, ball, plane, plain)
        there = np.isfinite(depth)
        name = f"photo {index:02d}.png"
        alpha = None if there.all() else np.where(there, 255, 0).astype(np.uint8)
        background = None if alpha is None else Background()
        photos.append(Photo(name, Path(name), colours, alpha=alpha, background=background))
        poses[name] = pose
        depths.append(depth)
    figures = Figures("drawn", len(photos), len(photos), focal, float("nan"), float("nan"), 0.0)
    cameras = Reconstruction(poses, dict.fromkeys(poses, lens), no_points(), figures)
    return DrawnScene(photos, cameras, depths)


def _photo(pose: Pose, lens: Lens, ball: bool, plane: bool, plain: bool) -> tuple[np.ndarray, np.ndarray]:
    finer = 2  # rays along each side of a px: what is finer than a px must not alias
    u, v = np.meshgrid((np.arange(lens.width * finer) + 0.5) / finer, (np.arange(lens.height * finer) + 0.5) / finer)
    local = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones_like(u)], -1).reshape(-1, 3)
    rays, centre = local @ pose.rotation, pose.centre
    depth, colour = np.full(len(rays), np.inf), np.ones((len(rays), 3))
    if plane:
        with np.errstate(divide="ignore"):
            far = (BEHIND - centre[2]) / rays[:, 2]
        hit = (far > 0) & np.isfinite(far)
        depth[hit] = far[hit]
        colour[hit] = 0.6 if plain else texture(centre + far[hit, None] * rays[hit], 1)
    if ball:
        a, b = (rays**2).sum(1), rays @ centre
        under = b**2 - a * (centre @ centre - RADIUS**2)
        near = (-b - np.sqrt(np.maximum(under, 0))) / a
        hit = (under > 0) & (near > 0)
        depth[hit] = near[hit]
        colour[hit] = texture(centre + near[hit, None] * rays[hit], 2)
    shape = (lens.height, finer, lens.width, finer)
    middle = depth.reshape(shape)[:, finer // 2, :, finer // 2]
    mean = colour.reshape(*shape, 3).mean((1, 3))
    return np.round(mean * 255).astype(np.uint8), middle


def arc(count: int, half: float = 0.35, distance: float = 5.0) -> np.ndarray:
    """[N, 3] in front of the scene, on an arc that also goes up and down."""
    angles = np.linspace(-half, half, count)
    up = 0.6 * np.sin(5 * np.arange(count))
    return np.stack([distance * np.sin(angles), up, -distance * np.cos(angles)], axis=1)


def around(count: int, distance: float = 5.0) -> np.ndarray:
    """[N, 3] all round, spread over a band of heights (a golden spiral)."""
    height = np.linspace(-0.6, 0.7, count)
    turn = np.arange(count) * np.pi * (3 - 5**0.5)
    flat = np.sqrt(1 - height**2)
    return distance * np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=1)
