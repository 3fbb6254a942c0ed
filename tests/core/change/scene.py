"""A wall of flat splats with a block, a knob and a crack, as a twin's folder with photos through a blur."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.cloud import GaussianCloud
from dgs.core.constants import SH_C0
from dgs.core.evaluation.poses import Similarity
from dgs.core.formats.colmap import write_model
from dgs.core.formats.turning import moved
from dgs.core.forward import ForwardModel, low_pass_on_grid, shared_medium
from dgs.core.frames import Frame
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.photos.write import write_png
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.grid import GridView
from dgs.core.twin.folder import TwinFolder
from dgs.core.views import SparsePoints, View

#: Px of the photos, their focal length; how far the wall is, and half of it; what a px of it covers.
WIDTH, HEIGHT, FOCAL = 144, 108, 150.0
AWAY, WALL = 3.0, (1.6, 1.2)
PX = AWAY / FOCAL
#: Of splats on the wall.
SPACING = 1.5 * PX
BLOCK, KNOB = (-0.55, 0.0), (0.6, 0.3)


@dataclass(frozen=True)
class Scene:
    """What stands on the wall.

    Attributes:
        out: px-equivalents that the block has come out; aside: that it has gone aside.
        knob: whether it is there; light: factor on all photos; noise: sRGB; seed: of the noise.
    """

    out: float = 0.0
    aside: float = 0.0
    knob: bool = True
    light: float = 1.0
    noise: float = 0.004
    seed: int = 0


def cloud_of(scene: Scene) -> GaussianCloud:
    """A textured wall, a textured block 4 px before it, and a knob of one colour 8 px before it."""
    random = np.random.default_rng(7)
    x, y = (np.arange(-half, half + SPACING, SPACING) for half in WALL)
    wall = np.stack([*(part.ravel() for part in np.meshgrid(x, y)), np.full(len(x) * len(y), AWAY)], axis=1)
    colours = random.uniform(0.2, 0.8, (len(wall), 3))
    block = (np.abs(wall[:, :2] - BLOCK) < 0.3).all(axis=1)
    wall[block] += (scene.aside * PX, 0.0, -(4.0 + scene.out) * PX)
    knob = np.linalg.norm(wall[:, :2] - KNOB, axis=1) < 0.22
    if scene.knob:
        wall[knob, 2] -= 8.0 * PX
        colours[knob] = (0.9, 0.3, 0.1)
    count = len(wall)
    scales = np.log(np.tile([0.8 * SPACING, 0.8 * SPACING, 0.02 * SPACING], (count, 1)))
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    sh = ((colours - 0.5) / SH_C0)[:, None]
    arrays = (wall, scales, turns, np.full(count, 6.0), sh)
    return GaussianCloud(*(np.ascontiguousarray(array, np.float32) for array in arrays))


def cameras(count: int = 12, shift: float = 0.0) -> dict[str, Camera]:
    """In two rows before the wall, up to 20 degrees aside."""
    found = {}
    for index, angle in enumerate(np.linspace(-0.35, 0.35, count) + shift):
        tilt = 0.15 if index % 2 else -0.15
        centre = np.array([np.sin(angle) * AWAY, np.sin(tilt) * AWAY, AWAY - np.cos(angle) * np.cos(tilt) * AWAY])
        forward = np.array([0.0, 0.0, AWAY]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        name = f"view_{index:02d}.png"
        found[name] = Camera(name, WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, rotation, -rotation @ centre)
    return found


def write_scene(place: Path, scene: Scene, world: Similarity | None = None, shift: float = 0.0) -> Path:
    """Photos and a perfect twin of a scene, `place`/twin, in another world if one is given."""
    cloud, views = cloud_of(scene), cameras(shift=shift)
    folder, paths = TwinFolder(place / "twin"), []
    random = np.random.default_rng(scene.seed)
    for name, camera in views.items():
        paths.append(place / "photos" / name)
        _write_photo(paths[-1], cloud, camera, scene, random)
    if world is not None:
        cloud = moved(cloud, world.rotation, world.scale, world.translation)
        views = {name: world.camera(camera) for name, camera in views.items()}
    folder.save_twin(cloud)
    folder.save_photo_list(paths)
    means = cloud.means.astype(np.float64)
    write_model(folder.camera_folder, views, SparsePoints(means, np.full(means.shape, 100, np.uint8)))
    run = {"photos": "photos", "out": "twin", "psf": PSF, "blur_space": "srgb", "holdout_every": 0, "frames": 9}
    run |= {"max_size": None, "seed": 0, "preset": "draft", "effects": "none", "cameras": None, "masks": None}
    folder.save_report({"settings": {"run": run, "training": {"sh_degree": 0}}, "steps": 300})
    return folder.path


#: The blur.
PSF = "gaussian:1.5"


def _write_photo(path: Path, cloud: GaussianCloud, camera: Camera, scene: Scene, random: np.random.Generator) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    settings, margin = RasterSettings(low_pass=low_pass_on_grid(1)), 6
    empty = View(camera, np.zeros((HEIGHT, WIDTH, 3), np.uint16))
    view = GridView(empty, camera, 1, parse_psf(PSF), "srgb")
    model = ForwardModel(settings, lambda v: shared_medium(v.psf, Frame(HEIGHT, WIDTH, margin), "srgb"), margin)
    with torch.no_grad():
        sharp = model.sharp(Gaussians.from_cloud(cloud), camera, torch.full((3,), 0.5)).image
        seen = model.medium(view).degraded(sharp).numpy()
    noisy = scene.light * seen + scene.noise * random.standard_normal(seen.shape)
    write_png(path, np.ascontiguousarray(np.round(noisy.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)))
