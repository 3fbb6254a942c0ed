"""A new photo finds its place among reference photos whose depth is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.files import write_json
from dgs.core.progress import Silent
from dgs.core.sfm.find import talk
from dgs.core.sfm.job import PLAN, REFERENCES, write_job
from dgs.core.sfm.placing import ReferencePhoto
from dgs.core.sfm.settings import SfmSettings
from scipy.ndimage import gaussian_filter

from .test_find_cameras import FOCAL, HEIGHT, SIGMA, WIDTH, cameras, kernel, photo, photographed, texture


def depth(camera: Camera) -> np.ndarray:
    """Of the two planes of `photographed`, along the axis; NaN on one of them, as where a twin is thin."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1) @ camera.rotation
    nearest = np.full((HEIGHT, WIDTH), np.inf)
    for plane, normal in enumerate(((1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))):
        at = -(camera.centre @ normal) / (rays @ np.array(normal))
        hit = camera.centre + at[..., None] * rays
        wanted = (at > 0) & (at < nearest) & ((hit[..., 0] < 0) == (plane == 1))
        nearest[wanted] = at[wanted]
    nearest[:40] = np.nan
    return nearest.astype(np.float32)


def placed(folder: Path, strangers: bool = False) -> tuple[dict[str, Camera], dict[str, Camera]]:
    """Poses found for two photos that four others know, and the true ones."""
    textures = [texture(1), texture(2)]
    truth = cameras(6)
    names = list(truth)
    other = [texture(7), texture(8)] if strangers else textures
    images = {
        name: gaussian_filter(photographed(camera, other if name in names[1:4:2] else textures), SIGMA, truncate=5)
        for name, camera in truth.items()
    }
    new = names[1:4:2]
    job = write_job([photo(n, images[n]) for n in names], kernel(SIGMA), SfmSettings(), folder)
    at = {name: image for image, name in job.items()}
    references = {}
    for index, name in enumerate(n for n in names if n not in new):
        camera = truth[name]
        np.save(folder / f"depth{index}.npy", depth(camera))
        references[at[name]] = {
            "rotation": camera.rotation.tolist(),
            "translation": camera.translation.tolist(),
            "focal": [camera.fx, camera.fy],
            "centre": [camera.cx, camera.cy],
            "depth": f"depth{index}.npy",
        }
    lens = {"model": "SIMPLE_PINHOLE", "width": WIDTH, "height": HEIGHT, "params": [FOCAL, WIDTH / 2, HEIGHT / 2]}
    write_json(folder / REFERENCES, list(references))
    write_json(folder / PLAN, {"references": references, "lens": lens})
    _, done = talk(folder, len(new), SfmSettings(), Silent())
    found = {}
    for image, pose in done["poses"].items():
        name = job[image]
        found[name] = truth[name].moved(np.array(pose["rotation"]), np.array(pose["translation"]))
    return found, {name: truth[name] for name in new}


def test_new_photos_find_their_place(tmp_path: Path) -> None:
    found, truth = placed(tmp_path)
    assert set(found) == set(truth)
    for name, camera in truth.items():
        off = np.linalg.norm(found[name].centre - camera.centre) / 4.0 * FOCAL
        turned = np.degrees(np.arccos((np.trace(found[name].rotation @ camera.rotation.T) - 1) / 2))
        assert off < 0.4 and turned < 0.05, (name, off, turned)


def test_photos_of_something_else_find_none(tmp_path: Path) -> None:
    assert placed(tmp_path, strangers=True)[0] == {}


def test_depth_lifts_a_ray_to_where_it_ends() -> None:
    surface = np.full((4, 6), 2.0, np.float32)
    surface[0] = np.nan
    one = ReferencePhoto(np.eye(3), np.array([0.0, 0.0, 1.0]), (2.0, 2.0), (3.0, 2.0), surface)
    points, good = one.lifted(np.array([[0.0, 0.0], [1.0, 0.5], [0.0, -1.0], [9.0, 0.0]]))
    assert good.tolist() == [True, True, False, False]
    assert points[0] == pytest.approx([0.0, 0.0, 1.0]) and points[1] == pytest.approx([2.0, 1.0, 1.0])
