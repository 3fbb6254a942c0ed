"""A camera moved by its photo: steps on a given twin, and what a step must not do."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.imaging.operator import BlurOperator
from dgs.core.rasterizer import render
from dgs.core.training.cameras.pose_steps import SETTINGS, photometric_step, twisted, units_of
from dgs.tests.core.training.training_scenes import HEIGHT, WIDTH, blurred_scene, camera_at
from scipy.spatial.transform import Rotation


def predictor(scene):
    psf = scene.medium.psf
    margin = 0 if psf is None else max(psf.radius)
    blur = BlurOperator(psf, HEIGHT, WIDTH, margin)

    def predict(camera: Camera) -> torch.Tensor:
        with torch.no_grad():
            return blur.apply(render(scene.truth, camera.with_margin(margin)).image)

    return predict


def apart(a: Camera, b: Camera, points) -> float:
    """Median px between the two cameras' views of the points."""
    seen = []
    for camera in (a, b):
        local = points @ camera.rotation.T + camera.translation
        seen.append(local[:, :2] / local[:, 2:] * camera.fx)
    return float(np.median(np.linalg.norm(seen[0] - seen[1], axis=1)))


@pytest.mark.parametrize("sigma", [0.0, 2.0])
def test_steps_find_the_camera_of_a_photo(sigma):
    scene = blurred_scene(2, sigma)
    view, predict = scene.views[1], predictor(scene)
    px = 1 / view.camera.fx
    camera = twisted(view.camera, px * np.array([3.0, -2.0, 4.0, 0.8, 1.0, -1.2]))
    points = scene.points.positions
    before = apart(camera, view.camera, points)
    for smooth in (4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0):
        photo = torch.from_numpy(view.planes())
        camera = twisted(camera, photometric_step(camera, photo, None, predict, smooth))
    assert before > 1.0
    assert apart(camera, view.camera, points) < 0.08 * before


def test_masked_px_move_nothing():
    scene = blurred_scene(2, 0.0)
    view, predict = scene.views[1], predictor(scene)
    photo = torch.from_numpy(view.planes()).clone()
    photo[:, :, :60] = photo[:, :, 2:62].clone()  # shifted by 2 px: it would move the camera
    valid = torch.ones(photo.shape[1:], dtype=torch.bool)
    valid[:, :65] = False
    units = units_of(view.camera)
    assert np.abs(photometric_step(view.camera, photo, valid, predict) / units).max() < 0.05
    assert np.abs(photometric_step(view.camera, photo, None, predict) / units).max() > 0.5


def test_a_step_is_no_longer_than_the_render_can_be_believed():
    scene = blurred_scene(2, 0.0)
    view, predict = scene.views[1], predictor(scene)
    far = twisted(view.camera, 30 / view.camera.fx * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    step = photometric_step(far, torch.from_numpy(view.planes()), None, predict) / units_of(far)
    assert np.abs(step).max() <= SETTINGS.longest + 1e-9
    free = photometric_step(far, torch.from_numpy(view.planes()), None, predict, 0.0, replace(SETTINGS, longest=1e9))
    assert np.abs(free / units_of(far)).max() > SETTINGS.longest


def flat_predictor(camera: Camera, slope: float, index: int):
    """The photo gets lighter, all over, by `slope` for each px that the camera moves along one of its axes."""
    units = units_of(camera)

    def predict(moved: Camera) -> torch.Tensor:
        turn = Rotation.from_matrix(moved.rotation @ camera.rotation.T)
        shift = moved.translation - turn.as_matrix() @ camera.translation
        twist = np.concatenate([shift, turn.as_rotvec()])
        return torch.full((3, 8, 8), 0.5 + slope * float(twist[index] / units[index]), dtype=torch.float64)

    return predict


@pytest.mark.parametrize("index", range(6))
def test_a_step_is_the_mean_of_what_the_photo_says_and_where_the_camera_was(index):
    """One unknown: the photo says x = r / s, precision n s^2 / r^2; the prior says 0, precision 1 / prior^2."""
    camera = camera_at(0.2, 0.1, "a", 8, 8)
    slope, off, prior, n = 1e-3, 2e-3, 0.1, 3 * 8 * 8
    photo = torch.full((3, 8, 8), 0.5 + off, dtype=torch.float64)
    settings = replace(SETTINGS, prior=prior, longest=1e9)
    step = photometric_step(camera, photo, None, flat_predictor(camera, slope, index), 0.0, settings)
    photos = n * slope**2 / off**2
    expected = np.zeros(6)
    expected[index] = (off / slope) * photos / (photos + 1 / prior**2)
    assert 0.2 < expected[index] / (off / slope) < 0.8, "both have a say"
    np.testing.assert_allclose(step / units_of(camera), expected, atol=1e-6)


def test_a_step_by_its_formula():
    """A photo that is linear in the twist: one Huber-weighted ridge solution, in px; then cut to the longest."""
    random = np.random.default_rng(0)
    here = Camera("a", 12, 8, 10.0, 10.0, 6.0, 4.0, np.eye(3), np.zeros(3))
    slopes, base = random.normal(0, 0.05, (6, 3, 8, 12)), random.uniform(0.3, 0.7, (3, 8, 12))
    units = np.array([0.1, 0.1, 0.2, 0.1, 0.1, 2 / 12])

    def predict(camera):
        twist = np.concatenate([camera.translation, Rotation.from_matrix(camera.rotation).as_rotvec()])
        return torch.from_numpy(base + np.tensordot(twist / units, slopes, 1))

    def by_hand(rest, counts):
        j, r = slopes.reshape(6, -1), rest.ravel()
        limit = max(1.345 * 1.4826 * np.sort(np.abs(r))[(r.size - 1) // 2], 1e-4)
        weight = np.minimum(limit / np.maximum(np.abs(r), 1e-12), 1.0) * counts.ravel()
        noise = max((weight * r**2).sum() / max(weight.sum(), 1.0), 1e-8)
        step = np.linalg.solve((j * weight) @ j.T / noise + np.eye(6) / 100, (j * weight) @ r / noise)
        return step * min(1.0, 3.0 / np.abs(step).max()) * units

    everywhere = np.ones((3, 8, 12))
    for size in (0.01, 2.0):
        rest = random.normal(0, 0.02, base.shape) + np.tensordot(size * np.arange(-2.0, 4.0), slopes, 1)
        photo = torch.from_numpy(base + rest)
        np.testing.assert_allclose(photometric_step(here, photo, None, predict), by_hand(rest, everywhere), rtol=1e-6)
        valid = torch.from_numpy(random.uniform(size=(8, 12)) > 0.3)
        masked = np.where(valid.numpy(), rest, 0.0)
        np.testing.assert_allclose(
            photometric_step(here, photo, valid, predict), by_hand(masked, everywhere * valid.numpy()), rtol=1e-6
        )
    assert np.abs(photometric_step(here, photo, None, predict) / units).max() == pytest.approx(3.0)
    np.testing.assert_allclose(photometric_step(here, torch.from_numpy(base), None, predict), 0.0, atol=1e-12)
