"""A tiny blurred set, rendered by the project's own rasterizer: a coloured, bumpy plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.constants import SH_C0
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import render
from dgs.core.training.settings import TrainingSettings
from dgs.core.views import SparsePoints, View

WIDTH, HEIGHT, FOCAL = 112, 96, 110.0
SIGMA = 2.0
#: Enough for a test, and without what the product's defaults may become.
SHORT = TrainingSettings(steps=40, max_gaussians=900, sh_degree=1, density_every=10, threads=1, seed=3)


@dataclass(frozen=True)
class Scene:
    """Blurred views, their sharp truth [3, H, W] by name, sparse points and the medium."""

    truth: Gaussians
    views: list[View]
    sharp: dict[str, np.ndarray]
    points: SparsePoints
    medium: Medium


def camera_at(x: float, y: float, name: str, width: int = WIDTH, height: int = HEIGHT) -> Camera:
    """Three units before the plane z = 0, looking at its middle."""
    centre = np.array([x, y, -3.0])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, width, height, FOCAL, FOCAL, width / 2, height / 2, rotation, -rotation @ centre)


def coloured_plane(seed: int = 0) -> Gaussians:
    """A bumpy plane that fills the frames, each Gaussian of a colour of its own, ~4 px apart."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-2.6, 2.6, 0.11), np.arange(-2.4, 2.4, 0.11))
    means = np.stack([x.ravel(), y.ravel(), 0.15 * np.sin(2 * x.ravel()) * np.cos(3 * y.ravel())], axis=1)
    n = len(means)
    colours = 0.5 + 0.25 * np.sin(means[:, :1] * 3 + [0.0, 1.0, 2.0]) + random.choice([-0.22, 0.22], (n, 3))
    return Gaussians(
        means=torch.tensor(means, dtype=torch.float32),
        log_scales=torch.full((n, 3), float(np.log(0.05))),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n, 1),
        opacity_logits=torch.full((n,), 3.0),
        sh=torch.tensor(((colours - 0.5) / SH_C0)[:, None, :], dtype=torch.float32),
    )


def photographed(truth: Gaussians, camera: Camera, psf: PointSpread | None) -> np.ndarray:
    """[3, H, W]: what `camera` takes through the medium; light from beyond the frame included."""
    margin = 0 if psf is None else max(psf.radius)
    with torch.no_grad():
        frame = render(truth, camera.with_margin(margin), backend="cpu").image
        return BlurOperator(psf, camera.height, camera.width, margin, frame.device).apply(frame).numpy()


def blurred_scene(count: int = 12, sigma: float = SIGMA, seed: int = 0) -> Scene:
    """`count` cameras on an ellipse before the plane; 8-bit photos."""
    truth = coloured_plane(seed)
    psf = PointSpread("gaussian", sigma, sigma) if sigma else None
    views, sharp = [], {}
    for index in range(count):
        angle = 2 * np.pi * index / count
        camera = camera_at(0.6 * np.cos(angle), 0.4 * np.sin(angle), f"view{index:02d}.png")
        planes = photographed(truth, camera, psf)
        photo = np.round(np.clip(planes, 0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)
        views.append(View(camera, np.ascontiguousarray(photo)))
        sharp[camera.name] = photographed(truth, camera, None)
    random = np.random.default_rng(seed)
    chosen = random.permutation(len(truth))[:300]
    points = truth.means.numpy()[chosen].astype(np.float64)
    colours = np.clip((truth.sh[chosen, 0].numpy() * SH_C0 + 0.5) * 255, 0, 255).astype(np.uint8)
    return Scene(truth, views, sharp, SparsePoints(points, colours), Medium(psf))


def moved(scene: Scene, size: float, offset: np.ndarray) -> Scene:
    """The same photos of the same scene, in another world: x' = size x + offset."""
    views = [
        replace(v, camera=v.camera.moved(v.camera.rotation, size * v.camera.translation - v.camera.rotation @ offset))
        for v in scene.views
    ]
    points = replace(scene.points, positions=scene.points.positions * size + offset)
    return replace(scene, views=views, points=points)


def same(a: Gaussians, b: Gaussians) -> bool:
    """Whether two twins are equal to the last bit."""
    return all(torch.equal(x, y) for (_, x), (_, y) in zip(a.named(), b.named(), strict=True))


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """In dB."""
    return float(-10 * np.log10(np.mean((np.clip(image, 0, 1) - np.clip(truth, 0, 1)) ** 2)))
