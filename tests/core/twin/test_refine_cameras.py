"""Cameras refined by what all photos agree on: wrong ones come right, right ones stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import Similarity, align_similarity
from dgs.core.evaluation.shifts import shifts_between
from dgs.core.progress import Silent
from dgs.core.training.cameras.bundle import SETTINGS, Observations, adjusted, aligned_camera
from dgs.core.training.cameras.pose_steps import twisted
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin import refine_cameras as refine_cameras_module
from dgs.core.twin.refine_cameras import Nearer, refine_cameras
from dgs.tests.core.training.training_scenes import blurred_scene
from scipy.ndimage import gaussian_filter, shift

PX = 100.0


def camera(centre: list[float]) -> Camera:
    """Looks along z from `centre`."""
    return Camera("", 200, 160, PX, PX, 100.0, 80.0, np.eye(3), -np.array(centre))


def seen_by(cameras: list[Camera], points: np.ndarray) -> Observations:
    """Every camera sees every point, exactly."""
    positions = []
    for c in cameras:
        local = points @ c.rotation.T + c.translation
        positions.append(local[:, :2] / local[:, 2:] * c.fx)
    n, m = len(cameras), len(points)
    return Observations(np.repeat(np.arange(n), m), np.tile(np.arange(m), n), np.concatenate(positions), np.ones(n * m))


def test_a_given_shift_is_found_to_a_tenth_of_a_px() -> None:
    picture = gaussian_filter(np.random.default_rng(0).normal(size=(3, 90, 120)), (0, 3, 3)) * 2 + 0.5
    photo = 0.9 * shift(picture, (0, 1.6, -2.3), order=3, mode="reflect") + 0.03  # darker: no shift
    found = shifts_between(picture, photo)
    inner = found.shift[:, 20:-20, 20:-20]
    assert np.median(inner[0]) == pytest.approx(-2.3, abs=0.1)
    assert np.median(inner[1]) == pytest.approx(1.6, abs=0.1)


def test_px_that_do_not_count_move_nothing() -> None:
    picture = gaussian_filter(np.random.default_rng(0).normal(size=(3, 90, 120)), (0, 3, 3)) * 2 + 0.5
    photo, valid = picture.copy(), np.ones((90, 120), bool)
    photo[:, 30:60, 30:80], valid[30:60, 30:80] = picture[:, 20:50, 40:90], False
    free = np.abs(shifts_between(picture, photo).shift[:, 35:55, 35:75]).mean()
    assert np.abs(shifts_between(picture, photo, valid).shift[:, 35:55, 35:75]).mean() < 0.5 * free


def test_adjustment_brings_shaken_cameras_back() -> None:
    random = np.random.default_rng(1)
    truth = [camera([0.4 * i, 0.1 * (i % 2), 0.0]) for i in range(6)]
    points = np.stack([random.uniform(-1, 3, 200), random.uniform(-1.5, 1.5, 200), random.uniform(2.5, 4, 200)], 1)
    seen = seen_by(truth, points)
    wrong = [twisted(c, random.normal(size=6) * [0.03, 0.03, 0.03, 0.01, 0.01, 0.01]) for c in truth]
    result = adjusted(wrong, points + random.normal(size=points.shape) * 0.03, seen, False)
    found, left = result.cameras, result.left
    assert left < 0.1
    named = lambda cameras: {str(i): c for i, c in enumerate(cameras)}  # noqa: E731

    def off(cameras: list[Camera]) -> float:
        alignment = align_similarity(named(cameras), named(truth))
        pairs = zip(cameras, truth, strict=True)
        return float(np.median([np.linalg.norm(alignment.camera(c).centre - t.centre) for c, t in pairs]))

    assert off(found) < 0.25 * off(wrong)


def test_one_camera_moves_to_where_points_are_seen_in_spite_of_outliers() -> None:
    random = np.random.default_rng(2)
    truth = camera([0.0, 0.0, 0.0])
    points = np.stack([random.uniform(-1, 1, 80), random.uniform(-1, 1, 80), random.uniform(2.5, 4, 80)], 1)
    position = seen_by([truth], points).position
    position[:12] += 30.0
    wrong = twisted(truth, np.array([0.03, -0.02, 0.02, 0.0, 0.01, 0.01]))
    found = aligned_camera(wrong, points, position, np.ones(80), replace(SETTINGS, camera_prior=30.0))
    assert np.abs(found.translation - truth.translation).max() < 2e-3


@pytest.mark.parametrize(
    ("after", "clear"), [([0.5, 0.6, 0.55, 0.5], True), ([1.0, 0.97, 1.02, 0.99], False), ([0.2, 2.5, 0.3, 1.5], False)]
)
def test_only_a_clear_gain_counts(after: list[float], clear: bool) -> None:
    assert Nearer.of(np.ones(4), np.array(after)).clear is clear


def test_wrong_cameras_come_right_and_right_ones_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(refine_cameras_module.SETTINGS, steps=120, round_steps=80, rounds=2)  # enough for 112 x 96 px
    monkeypatch.setattr(refine_cameras_module, "SETTINGS", short)
    scene = blurred_scene(12, 2.0)
    settings = TrainingSettings(max_gaussians=1200, sh_degree=0, threads=1)
    random = np.random.default_rng(1)
    size = 3.0 / scene.views[0].camera.fx
    shaken = [
        replace(v, camera=twisted(v.camera, random.normal(size=6) * size * np.array([3, 3, 3, 1, 1, 1]) / 2))
        for v in scene.views
    ]
    truth = {v.name: v.camera for v in scene.views}

    def off(cameras: dict[str, Camera], aligned: bool = True) -> float:
        alignment = align_similarity(cameras, truth) if aligned else Similarity(1.0, np.eye(3), np.zeros(3), 3)
        px = []
        for name, c in cameras.items():
            a, b = alignment.camera(c), truth[name]
            local = [scene.points.positions @ k.rotation.T + k.translation for k in (a, b)]
            px.append(np.median(np.linalg.norm(np.subtract(*(p[:, :2] / p[:, 2:] for p in local)), axis=1)) * b.fx)
        return float(np.median(px))

    judges = shaken[::4]
    fit = [v for v in shaken if v not in judges]
    found = refine_cameras(fit, judges, scene.points, scene.medium, settings, Silent(), focal=False)
    assert found.kept
    assert off(found.cameras) < 0.5 * off({v.name: v.camera for v in shaken})
    # The world stays where the cameras saw it, too: what took no part is seen where it is.
    assert off(found.cameras, aligned=False) < 0.5 * off({v.name: v.camera for v in shaken}, aligned=False)
    right = refine_cameras(
        [v for i, v in enumerate(scene.views) if i % 4],
        list(scene.views[::4]),
        scene.points,
        scene.medium,
        settings,
        Silent(),
        focal=False,
    )
    assert not right.kept
    assert right.cameras == truth
