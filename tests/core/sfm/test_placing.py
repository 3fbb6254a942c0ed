"""A new photo finds its place among reference photos whose depth is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from dgs.core.camera import Camera
from dgs.core.files import write_json
from dgs.core.progress import Silent
from dgs.core.sfm import placing
from dgs.core.sfm.features import FEATURES, load_features, save_features
from dgs.core.sfm.find import talk
from dgs.core.sfm.job import KEPT, PLAN, REFERENCES, read_job, write_job
from dgs.core.sfm.placing import ReferencePhoto, _posed, run
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


def seen_from(count: int, wrong: int = 0) -> tuple[np.ndarray, np.ndarray, Camera]:
    """Points, and where a camera shows them; the last `wrong` of them elsewhere."""
    camera = cameras(3)["été 0.png"]
    noise = np.random.default_rng(0)
    world = noise.uniform(-1, 1, (count, 3))
    local = world @ camera.rotation.T + camera.translation
    pixels = local[:, :2] / local[:, 2:] * FOCAL + [WIDTH / 2, HEIGHT / 2]
    if wrong:
        pixels[-wrong:] = noise.uniform([0, 0], [WIDTH, HEIGHT], (wrong, 2))
    return pixels, world, camera


@pytest.mark.parametrize(
    ("count", "wrong", "found"), [(60, 0, True), (59, 0, False), (200, 100, True), (100, 60, False)]
)
def test_a_pose_needs_enough_matches_that_agree(count: int, wrong: int, found: bool) -> None:
    pixels, world, camera = seen_from(count, wrong)
    lens = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=WIDTH, height=HEIGHT, params=[FOCAL, WIDTH / 2, HEIGHT / 2], camera_id=1
    )
    pose = _posed(pixels, world, lens, 0)
    assert (pose is not None) == found
    if pose is not None:
        np.testing.assert_allclose(pose["rotation"], camera.rotation, atol=1e-4)
        np.testing.assert_allclose(pose["translation"], camera.translation, atol=1e-3)
        assert count - wrong <= pose["inliers"] <= count - wrong + 5


def test_new_photos_are_placed_in_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the child does it: first with the references' photos, then with the features that were kept of them."""
    textures = [texture(1), texture(2)]
    truth = cameras(5)
    names = list(truth)
    images = {n: gaussian_filter(photographed(c, textures), SIGMA, truncate=5) for n, c in truth.items()}
    new = names[2]
    earlier: dict[str, str] = {}
    for kept in (False, True):
        folder = tmp_path / f"{kept}"
        shown = [new] if kept else names
        job = write_job([photo(n, images[n]) for n in shown], kernel(SIGMA), SfmSettings(), folder)
        at = {name: image for image, name in job.items()} | ({n: n for n in names if n != new} if kept else {})
        references = {}
        for index, name in enumerate(n for n in names if n != new):
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
        plan = {"references": references, "lens": lens}  # comes when it is waited for
        monkeypatch.setattr(placing, "wait_for", lambda path, late=plan: write_json(path, late))
        if kept:
            features, recipe = load_features(tmp_path / "False" / FEATURES)
            save_features(folder / KEPT, {earlier[image]: one for image, one in features.items()}, recipe)
        earlier = {**earlier, **job}
        said: list[dict[str, object]] = []
        result = run(read_job(folder), lambda heard=said, **message: heard.append(message))
        assert result.kind == "done" and set(result.message["poses"]) == {at[new]}
        pose = result.message["poses"][at[new]]
        found = truth[new].moved(np.array(pose["rotation"]), np.array(pose["translation"]))
        assert np.linalg.norm(found.centre - truth[new].centre) / 4.0 * FOCAL < 0.6
        assert said == [
            {"stage": "features", "recipe": "placing"},
            {"stage": "matches", "recipe": "placing"},
            {"joined": 1},
        ]
        mine = load_features(folder / FEATURES)
        assert mine is not None and set(mine[0]) == set(job)
