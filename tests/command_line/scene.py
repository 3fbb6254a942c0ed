"""A small real set: a few Gaussians photographed through a blur by known cameras, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.formats.colmap import write_model
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.rasterizer import render
from dgs.core.views import SparsePoints
from PIL import Image

WIDTH, HEIGHT, SIGMA = 160, 120, 2.5


def scene_gaussians(count: int = 2500) -> Gaussians:
    """Coloured blobs on a bumpy sheet."""
    random = torch.Generator().manual_seed(1)
    xy = torch.rand((count, 2), generator=random) * 4 - 2
    means = torch.cat([xy, 0.2 * torch.sin(3 * xy[:, :1])], dim=1)
    return Gaussians(
        means=means,
        log_scales=torch.full((count, 3), -3.2) + 0.3 * torch.randn((count, 3), generator=random),
        quaternions=torch.randn((count, 4), generator=random),
        opacity_logits=torch.full((count,), 2.0),
        sh=torch.randn((count, 1, 3), generator=random),
    )


def scene_cameras(count: int = 9) -> list[Camera]:
    """Along an arc in front of the sheet, looking at its middle."""
    cameras = []
    for index, angle in enumerate(np.linspace(-0.4, 0.4, count)):
        centre = np.array([5 * np.sin(angle), 0.3 * np.cos(7 * angle), -5 * np.cos(angle)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        name = f"phöto {index:02d}.png"
        cameras.append(Camera(name, WIDTH, HEIGHT, 180.0, 180.0, WIDTH / 2, HEIGHT / 2, rotation, -rotation @ centre))
    return cameras


def write_scene(folder: Path) -> None:
    """Writes photos/ (blurred), sharp/ and model/ (COLMAP) into `folder`."""
    gaussians, cameras = scene_gaussians(), scene_cameras()
    medium = Medium(parse_psf(f"gaussian:{SIGMA}"))
    assert medium.psf is not None
    margin = max(medium.psf.radius)
    blur = BlurOperator(medium.psf, HEIGHT, WIDTH, margin)
    for name in ("photos", "sharp"):
        (folder / name).mkdir(parents=True)
    for camera in cameras:
        frame = render(gaussians, camera.with_margin(margin)).image.detach()
        sharp = frame[:, margin:-margin, margin:-margin]
        for where, image in (("photos", blur.apply(frame)), ("sharp", sharp)):
            pixels = (image.clamp(0, 1) * 255).round().byte().permute(1, 2, 0).numpy()
            Image.fromarray(pixels).save(folder / where / camera.name)
    points = gaussians.means.double().numpy()
    write_model(
        folder / "model",
        {camera.name: camera for camera in cameras},
        SparsePoints(points, np.full((len(points), 3), 128, np.uint8)),
    )
