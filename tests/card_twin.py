"""A whole twin's folder without training: a painted card of known sizes, and photos of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.formats.colmap import write_model
from dgs.core.forward import sharp_view
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings
from dgs.core.twin.folder import TwinFolder
from dgs.core.views import SparsePoints
from PIL import Image

#: Of the photos, px; a px is DEPTH / FOCAL wide on the card.
WIDTH, HEIGHT, FOCAL, DEPTH = 120, 90, 130.0, 2.0
#: Half the sides of the bright rectangle in the middle, and of the dark line in it, along x and y.
RECTANGLE, LINE = (0.45, 0.3), (0.08, 0.3)
#: Half the sides of the card: beyond it nothing is.
CARD = (0.65, 0.48)
#: Where the cameras stand, x and y.
STANDS = ((-0.5, -0.2), (0.0, 0.0), (0.5, 0.1), (0.1, 0.5), (-0.2, -0.5))


def card() -> Gaussians:
    """Flat splats in the plane z = DEPTH, closer than a px; faint, so that none of them hides its neighbours."""
    step = 0.4 * DEPTH / FOCAL
    x, y = (part.ravel() for part in np.meshgrid(*(np.arange(-half, half, step) + step / 2 for half in CARD)))
    random = np.random.default_rng(3)
    grey = 0.3 + 0.1 * random.random(len(x))
    inside = (np.abs(x) < RECTANGLE[0]) & (np.abs(y) < RECTANGLE[1])
    line = (np.abs(x) < LINE[0]) & (np.abs(y) < LINE[1])
    grey = np.where(line, 0.05, np.where(inside, 0.85 + 0.1 * random.random(len(x)), grey))
    colours = np.stack([grey, 0.9 * grey, 0.7 * grey], axis=1)
    means = np.stack([x, y, np.full_like(x, DEPTH)], axis=1)
    scales = np.tile([0.6 * step, 0.6 * step, 0.02 * step], (len(x), 1))
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (len(x), 1))
    arrays = (means, np.log(scales), quaternions, np.full(len(x), -0.85), ((colours - 0.5) / 0.28209479)[:, None])
    return Gaussians(*(torch.tensor(array, dtype=torch.float32) for array in arrays))


def cameras() -> list[Camera]:
    """They look along z."""
    return [
        Camera(f"{index}.png", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.array([-x, -y, 0.0]))
        for index, (x, y) in enumerate(STANDS)
    ]


def write_card_twin(place: Path, gaussians: Gaussians | None = None) -> Path:
    """Writes `place`/photos and `place`/twin; returns the latter."""
    gaussians, folder, photos = gaussians or card(), TwinFolder(place / "twin"), place / "photos"
    photos.mkdir(parents=True)
    for camera in cameras():
        with torch.no_grad():
            image = sharp_view(gaussians, camera, RasterSettings()).image.numpy()
        Image.fromarray(np.round(image.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)).save(photos / camera.name)
    places = gaussians.means.numpy()[::50].astype(np.float64)
    folder.save_twin(gaussians.cloud())
    folder.save_photo_list([photos / camera.name for camera in cameras()])
    points = SparsePoints(places, np.full(places.shape, 99, np.uint8))
    write_model(folder.camera_folder, {camera.name: camera for camera in cameras()}, points)
    run = {"photos": str(photos), "out": "twin", "psf": "none", "blur_space": "srgb", "holdout_every": 0, "frames": 9}
    run |= {"max_size": None, "seed": 0, "preset": "draft", "effects": "none", "cameras": None, "masks": None}
    heldout = {"names": [], "degraded": {"psnr": 40.0}, "sharp": None}
    report = {"photos": {"folder": str(photos)}, "steps": 300, "medium": {"psf": "none"}, "heldout": heldout}
    folder.save_report({**report, "settings": {"run": run, "training": {"sh_degree": 0}}})
    return folder.path
