"""A twin of real photos as a world that a real camera could not be asked about: renders are its truth.

What real photos show (sand, carpet, print) no scene of the laboratory has. `shaken_twin` and `defocused_twin` average
a twin's renders, in linear light, over where the light of an exposure came through.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.formats.cameras import read_cameras
from dgs.core.formats.ply import read_ply
from dgs.core.formats.transforms import write_transforms
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render
from PIL import Image
from scipy.spatial.transform import Rotation

#: Every so many views are as sharp as the twin; noise (of 1) and JPEG's quality of the photos.
SHARP, NOISE, QUALITY = 8, 0.008, 93


@dataclass(frozen=True)
class World:
    """A twin: its Gaussians, its cameras, and its points [M, 3]."""

    gaussians: Gaussians
    cameras: list[Camera]
    points: np.ndarray


def open_world(twin: Path) -> World:
    """The twin of a folder."""
    model = read_cameras(twin / "cameras")
    cameras = [camera for _, camera in sorted(model.pinholes().items())]
    return World(Gaussians.from_cloud(read_ply(twin / "twin.ply")), cameras, np.asarray(model.points().positions))


def chosen_cameras(world: World, count: int, width: int, random: np.random.Generator) -> list[Camera]:
    """As many as asked for, `width` px wide."""
    centres = np.stack([camera.centre for camera in world.cameras])
    middle = centres[np.argmin(np.linalg.norm(centres - np.median(centres, axis=0), axis=1))]
    nearest = np.argsort(np.linalg.norm(centres - middle, axis=1))[:count]
    chosen = [world.cameras[at] for at in sorted(nearest)]
    while len(chosen) < count:
        chosen.append(_between(world.cameras, centres, random))
    sized = [camera.resized(width, round(camera.height * width / camera.width)) for camera in chosen]
    return [replace(camera, name=f"photo_{index:03d}.jpg") for index, camera in enumerate(sized)]


def _between(cameras: list[Camera], centres: np.ndarray, random: np.random.Generator) -> Camera:
    """One between a camera and one of its three neighbours."""
    first = int(random.integers(len(cameras)))
    second = int(random.choice(np.argsort(np.linalg.norm(centres - centres[first], axis=1))[1:4]))
    share = random.uniform(0.25, 0.75)
    turn = Rotation.from_matrix(cameras[second].rotation @ cameras[first].rotation.T).as_rotvec()
    rotation = Rotation.from_rotvec(share * turn).as_matrix() @ cameras[first].rotation
    centre = (1 - share) * centres[first] + share * centres[second]
    return cameras[first].moved(rotation, -rotation @ centre)


def light(world: World, cameras: Sequence[Camera]) -> np.ndarray:
    """[H, W, 3] linear light of an exposure: the mean of what the cameras see."""
    total = np.zeros((cameras[0].height, cameras[0].width, 3))
    for camera in cameras:
        with torch.no_grad():
            picture = render(world.gaussians, camera, settings=RasterSettings()).image
        total += srgb_to_linear(np.clip(picture.permute(1, 2, 0).numpy().astype(np.float64), 0.0, 1.0))
    return total / len(cameras)


def save_photo(
    folder: Path, camera: Camera, exposed: np.ndarray, sharp: np.ndarray, random: np.random.Generator
) -> None:
    """A photo of linear light [H, W, 3], with noise, and what it shows without any."""
    for name in ("photos", "sharp"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _save(folder / "photos" / camera.name, exposed, NOISE * random.normal(size=sharp.shape), QUALITY)
    _save(folder / "sharp" / camera.name, sharp, 0.0, 97)


def write_truth(
    folder: Path, cameras: Sequence[Camera], media: Mapping[str, object], through: Mapping[str, object]
) -> None:
    """`transforms.json` and `manifest.json`: what all photos were taken through, and each of them."""
    write_transforms(folder / "transforms.json", {camera.name: camera for camera in cameras})
    held = [camera.name for camera in cameras[::SHARP]]
    manifest = {"held_out": held, "media": media, "through": through}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def _save(path: Path, linear: np.ndarray, noise: np.ndarray | float, quality: int) -> None:
    """An sRGB JPEG."""
    encoded = np.clip(linear_to_srgb(linear) + noise, 0.0, 1.0)
    Image.fromarray(np.round(encoded * 255).astype(np.uint8)).save(path, quality=quality)
