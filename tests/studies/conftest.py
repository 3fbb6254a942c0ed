"""A rendered set with everything that a comparison can use: cameras, a painted line, masks, depth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.formats.colmap import write_model
from dgs.core.views import SparsePoints
from dgs.studies.comparison import degrade
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

WIDTH, HEIGHT, SIGMA, VIEWS = 96, 80, 1.5, 9
#: The wall z = 0 carries a picture of 4 x 4 units with this many px per unit.
PER_UNIT = 100
LINE_WIDTH = 0.4
#: Where the line is read: fitting its edges takes most of a comparison's time, in each view of each twin.
STATIONS = 21


def wall() -> np.ndarray:
    """[400, 400, 3] a textured wall with a red upright line in its middle."""
    generator = np.random.default_rng(2)
    texture = gaussian_filter(generator.normal(size=(400, 400, 3)), (6, 6, 0))
    texture = 0.5 + 0.12 * texture / texture.std()
    edge = LINE_WIDTH * PER_UNIT / 2
    texture[:, int(200 - edge) : int(200 + edge)] = [0.75, 0.05, 0.05]
    return np.clip(texture, 0, 1)


def cameras() -> list[Camera]:
    """Along an arc before the wall."""
    found = []
    for index, angle in enumerate(np.linspace(-0.3, 0.3, VIEWS)):
        centre = np.array([4 * np.sin(angle), 0.4 * np.cos(5 * angle), -4 * np.cos(angle)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        found.append(
            Camera(
                f"view_{index:03d}.png",
                WIDTH,
                HEIGHT,
                130.0,
                130.0,
                WIDTH / 2,
                HEIGHT / 2,
                rotation,
                -rotation @ centre,
            )
        )
    return found


def seen(camera: Camera, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] the wall through the camera (4 x 4 rays a pixel), and [H, W] its depth."""
    fine = (np.arange(4) + 0.5) / 4
    rows = (np.arange(HEIGHT)[:, None] + fine).ravel()
    columns = (np.arange(WIDTH)[:, None] + fine).ravel()
    y, x = np.meshgrid((rows - camera.cy) / camera.fy, (columns - camera.cx) / camera.fx, indexing="ij")
    rays = np.stack([x, y, np.ones_like(x)], -1) @ camera.rotation
    depth = -camera.centre[2] / rays[..., 2]
    places = camera.centre + depth[..., None] * rays
    at = [(places[..., 1] + 2) * PER_UNIT - 0.5, (places[..., 0] + 2) * PER_UNIT - 0.5]
    image = np.stack([map_coordinates(plane, at, order=1, mode="reflect") for plane in picture.transpose(2, 0, 1)], -1)
    return (
        image.reshape(HEIGHT, 4, WIDTH, 4, 3).mean((1, 3)),
        depth.reshape(HEIGHT, 4, WIDTH, 4).mean((1, 3)).astype(np.float32),
    )


@pytest.fixture(scope="session")
def rendered_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder as `synthesize` writes it."""
    folder = tmp_path_factory.mktemp("set") / "wall"
    for name in ("photos", "sharp", "masks_ball", "depth"):
        (folder / name).mkdir(parents=True)
    picture = wall()
    for camera in cameras():
        image, depth = seen(camera, picture)
        sharp = np.rint(image * 255).astype(np.uint8)
        Image.fromarray(sharp).save(folder / "sharp" / camera.name)
        Image.fromarray(degrade.photographed(sharp, degrade.gaussian(SIGMA))).save(folder / "photos" / camera.name)
        Image.fromarray(np.full((HEIGHT, WIDTH), 255, np.uint8)).save(folder / "masks_ball" / camera.name)
        np.save(folder / "depth" / f"{Path(camera.name).stem}.npy", depth)
    generator = np.random.default_rng(0)
    points = np.c_[generator.uniform(-1.5, 1.5, (600, 2)), np.zeros(600)]
    colours = [picture[int((y + 2) * PER_UNIT), int((x + 2) * PER_UNIT)] * 255 for x, y, _ in points]
    sparse = SparsePoints(points, np.array(colours, np.uint8))
    write_model(folder / "cameras", {camera.name: camera for camera in cameras()}, sparse)
    heights = np.linspace(-1.5, 1.5, STATIONS)
    line = {
        "name": "red",
        "width_m": LINE_WIDTH,
        "points": [[0.0, y, 0.0] for y in heights],
        "across": [[1.0, 0.0, 0.0]] * STATIONS,
        "normals": [[0.0, 0.0, -1.0]] * STATIONS,
    }
    (folder / "lines.json").write_text(json.dumps([line]))
    (folder / "psf.json").write_text(json.dumps({"psf": f"gaussian:{SIGMA}", "blur_space": "srgb"}))
    (folder / "manifest.json").write_text("{}")
    return folder
