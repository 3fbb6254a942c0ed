"""Small sets of photos for training, taken of textured planes by intersecting rays: no splats, so no inverse crime.

8-bit photos of two planes that meet at a right angle, blurred, with noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import convolve, gaussian_filter, map_coordinates

from ...core.camera import Camera
from ...core.imaging.formation.chain import Formation
from ...core.imaging.medium import Medium
from ...core.imaging.psf import PointSpread
from ...core.training.loss.photometric import PhotometricLoss
from ...core.training.settings import TrainingSettings
from ...core.training.trainer import Trainer
from ...core.views import SparsePoints, View

Array = NDArray[np.float64]

WIDTH, HEIGHT, FOCAL = 64, 48, 62.0
SIGMA = 1.5
#: Standard deviation of the photos' noise.
NOISE = 0.004
#: Short and small, and without what the product's defaults may become.
SHORT = TrainingSettings(steps=100, max_gaussians=400, density_every=100, seed=3, low_pass=1.0)


def arc(count: int, radius: float = 3.0) -> list[Array]:
    """Camera centres on an arc before the corner, not in one plane."""
    angles = np.linspace(-0.45, 0.45, count)
    return [radius * np.array([np.sin(a), 0.2 * np.cos(7 * a), -np.cos(a)]) for a in angles]


def looking(
    centre: Array, at: Array, name: str, width: int = WIDTH, height: int = HEIGHT, focal: float = FOCAL
) -> Camera:
    """A camera that looks at a point, upright."""
    forward = (at - centre) / np.linalg.norm(at - centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, width, height, focal, focal, width / 2, height / 2, rotation, -rotation @ centre)


def texture(seed: int, size: int = 300) -> Array:
    """Blobs and edges of many sizes in three colours, [3, size, size] in [0, 1]."""
    noise = np.random.default_rng(seed)
    total = np.zeros((3, size, size))
    for width in (2.0, 4.0, 9.0):
        layer = gaussian_filter(noise.standard_normal((size, size)), width, mode="wrap")
        tint = noise.uniform(0.3, 1.0, (3, 1, 1))
        total += tint * (np.sign(layer) + layer / layer.std())
    return np.asarray((total - total.min()) / np.ptp(total))


def sharp_photo(camera: Camera, textures: Sequence[Array], flat: bool = False) -> Array:
    """[3, H, W]: two planes, x + z = 0 and z - x = 0, that meet in the y axis; or the plane z = 0 alone."""
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1) @ camera.rotation
    image, nearest = np.zeros((3, camera.height, camera.width)), np.full(u.shape, np.inf)
    normals = [np.array([0.0, 0.0, 1.0])] if flat else [np.array([1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0])]
    scale = textures[0].shape[1] / 6.0
    for plane, normal in enumerate(normals):
        depth = -(camera.centre @ normal) / (rays @ normal)
        hit = camera.centre + depth[..., None] * rays
        wanted = (depth > 0) & (depth < nearest) & (flat | ((hit[..., 0] < 0) == (plane == 1)))
        at = [hit[..., 1] * scale, hit[..., 0] * scale]
        for channel in range(3):
            seen = map_coordinates(textures[plane][channel], at, order=1, mode="grid-wrap")
            image[channel][wanted] = seen[wanted]
        nearest[wanted] = depth[wanted]
    return image


def corner_points(count: int, seed: int = 0, flat: bool = False) -> SparsePoints:
    """Points on the planes, with a millimetre of noise."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(-1.4, 1.4, count), random.uniform(-1.1, 1.1, count)
    z = np.zeros(count) if flat else -np.abs(x)
    positions = np.stack([x, y, z], axis=1) + 1e-3 * random.standard_normal((count, 3))
    return SparsePoints(positions, np.full((count, 3), 128, np.uint8))


def photographs(
    cameras: Sequence[Camera], kernel: Array | float = SIGMA, exposure: float = 1.0, flat: bool = False, seed: int = 0
) -> list[View]:
    """8-bit photos through a blur (standard deviation in px, or a kernel), with noise, clipped at white."""
    random, textures = np.random.default_rng(seed), (texture(1), texture(2))
    views = []
    for camera in cameras:
        m = 0 if isinstance(kernel, float) and kernel == 0.0 else 12
        planes = sharp_photo(camera.with_margin(m), textures, flat) * exposure
        if isinstance(kernel, float):
            planes = gaussian_filter(planes, (0, kernel, kernel)) if kernel else planes
        else:
            planes = convolve(planes, kernel[None])
        planes = planes[:, m : m + camera.height, m : m + camera.width]
        planes = planes + NOISE * random.standard_normal(planes.shape)
        photo = np.round(np.clip(planes, 0.0, 1.0) * 255).astype(np.uint8).transpose(1, 2, 0)
        views.append(View(camera, np.ascontiguousarray(photo)))
    return views


def small_set(count: int = 8, sigma: float = SIGMA, **options: Any) -> tuple[list[View], SparsePoints, Medium]:
    """Views on an arc, points and medium."""
    cameras = [looking(centre, np.zeros(3), f"view{i}.png") for i, centre in enumerate(arc(count))]
    medium = Medium(PointSpread("gaussian", sigma, sigma) if sigma else None)
    return photographs(cameras, sigma, **options), corner_points(200), medium


def moved_world(
    views: Sequence[View], points: SparsePoints, size: float, offset: Array
) -> tuple[list[View], SparsePoints]:
    """The same photos in another world: x' = size x + offset."""
    cameras = [
        v.camera.moved(v.camera.rotation, size * v.camera.translation - v.camera.rotation @ offset) for v in views
    ]
    there = [replace(view, camera=camera) for view, camera in zip(views, cameras, strict=True)]
    return there, replace(points, positions=points.positions * size + offset)


def trained_steps(
    views: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    steps: int,
    begin: Callable[[Trainer], None] | None = None,
    **changes: Any,
) -> Trainer:
    """A trainer after `steps` iterations; `begin` may alter what it starts from, `formation` is among `changes`."""
    formation = changes.pop("formation", Formation())
    trainer = Trainer(views, [], points, medium, replace(SHORT, **{"steps": steps, **changes}), formation)
    if begin is not None:
        begin(trainer)
    for step in range(steps):
        trainer.advance(step / steps)
    return trainer


def misfit(trainer: Trainer) -> float:
    """Mean photometric loss of the degraded renders against all photos of the training, masks respected."""
    level, losses = trainer.levels[-1], []
    for view in level.views:
        with torch.no_grad():
            degraded = trainer.exposed(level, view).degraded.cpu()
        mask = None if view.valid is None else torch.from_numpy(view.valid)
        losses.append(
            PhotometricLoss(torch.from_numpy(view.planes()), mask).value_and_gradient(degraded.contiguous())[0]
        )
    return float(np.mean(losses))
