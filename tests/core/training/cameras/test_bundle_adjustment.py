"""Bundle adjustment ends at a minimum of what it says it minimizes, and weak information gives way to the prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.training.cameras.bundle import (
    SETTINGS,
    AdjustmentSettings,
    Observations,
    _Problem,
    _State,
    adjusted,
    aligned_camera,
    contradiction,
)
from dgs.core.training.cameras.pose_steps import twisted
from scipy.optimize import least_squares

PX = 100.0


def camera(x: float, y: float = 0.0) -> Camera:
    return Camera("", 200, 160, PX, PX, 100.0, 80.0, np.eye(3), -np.array([x, y, 0.0]))


def projected(c: Camera, points: np.ndarray) -> np.ndarray:
    local = points @ c.rotation.T + c.translation
    return local[:, :2] / local[:, 2:] * c.fx


def scattered(count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.stack([random.uniform(-1, 1, count), random.uniform(-1, 1, count), random.uniform(2.5, 4, count)], 1)


def seen_by(cameras: list[Camera], points: np.ndarray, error: float = 1.0) -> Observations:
    n, m = len(cameras), len(points)
    positions = np.concatenate([projected(c, points) for c in cameras])
    return Observations(np.repeat(np.arange(n), m), np.tile(np.arange(m), n), positions, np.full(n * m, error))


@pytest.mark.parametrize("prior", [1e-3, 1e3])
def test_a_camera_lies_between_where_it_was_and_where_the_points_are_seen(prior: float) -> None:
    """Stiff: it stays. Loose: it goes all the way."""
    truth, points = camera(0.0), scattered(60, 0)
    began = twisted(truth, np.array([0.03, -0.02, 0.02, 0.0, 0.01, 0.01]))
    position = projected(truth, points)
    found = aligned_camera(began, points, position, np.ones(60), replace(SETTINGS, camera_prior=prior))
    goal = began if prior < 1.0 else truth
    np.testing.assert_allclose(found.translation, goal.translation, atol=2e-5)
    np.testing.assert_allclose(found.rotation, goal.rotation, atol=2e-5)


def test_a_camera_does_not_run_away_from_where_it_was() -> None:
    """Between stiff and loose it stays between the two, on the way, however often it is asked."""
    truth, points = camera(0.0), scattered(60, 0)
    began = twisted(truth, np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0]))
    away = []
    for prior in (0.02, 0.05, 0.1, 0.2, 0.5, 3.0):
        found = aligned_camera(
            began, points, projected(truth, points), np.ones(60), replace(SETTINGS, camera_prior=prior, iterations=60)
        )
        away.append(float(np.abs(projected(found, points) - projected(truth, points)).max()))
    assert away == sorted(away, reverse=True)
    assert away[0] < np.abs(projected(began, points) - projected(truth, points)).max() + 1e-6


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_right_cameras_are_contradicted_by_chance_alone(noise: float) -> None:
    """Whatever the noise: about 1 where cameras are right, many times that where they are off by as much as it."""
    points, settings = scattered(150, 1), replace(SETTINGS, camera_prior=50.0, observations_per_fact=1.0)
    truth = [
        twisted(camera(0.5 * i, 0.2 * (i % 2)), np.array([0, 0, 0, 0.05 * i, -0.1 * i, 0.1 * i])) for i in range(5)
    ]
    random, said = np.random.default_rng(2), []
    exact = seen_by(truth, points, error=1.0)
    seen = replace(exact, position=exact.position + noise * random.standard_normal(exact.position.shape))
    for beside in (0.0, noise / PX):
        cameras = [twisted(c, np.append(3.0 * beside * random.standard_normal(3), np.zeros(3))) for c in truth]
        found = adjusted(cameras, points, seen, False, settings)
        said.append(contradiction(cameras, points, seen, found, settings))
    assert 0.2 < said[0] < 1.5
    assert said[1] > 10.0 * said[0]


def zoomed(c: Camera, factor: float) -> Camera:
    return replace(c, fx=c.fx * factor, fy=c.fy * factor)


@pytest.mark.parametrize(("prior", "share"), [(1e-5, 0.0), (10.0, 1.0)])
def test_a_focal_length_is_held_as_loosely_as_it_is_said(prior: float, share: float) -> None:
    """Two per cent too long a focal length: held, or found."""
    points = scattered(150, 1)
    truth = [
        twisted(camera(0.5 * i, 0.2 * (i % 2)), np.array([0, 0, 0, 0.05 * i, -0.1 * i, 0.1 * i])) for i in range(5)
    ]
    settings = replace(SETTINGS, camera_prior=50.0, focal_prior=prior, iterations=30)
    result = adjusted([zoomed(c, 1.02) for c in truth], points, seen_by(truth, points), True, settings)
    found, left = result.cameras, result.left
    assert found[0].fx / PX == pytest.approx(1.02 ** (1 - share), abs=2e-4)
    assert (left < 1e-3) == (share == 1.0)
    assert len({c.fx for c in found} | {c.fy for c in found}) == 1, "one focal length for all"
    fixed = adjusted([zoomed(c, 1.02) for c in truth], points, seen_by(truth, points), False, settings).cameras
    assert fixed[0].fx == pytest.approx(1.02 * PX, rel=1e-9)


def test_what_is_minimized_in_closed_form() -> None:
    """Photos that agree cost nothing; a camera that is off by its prior, or the focal length by its, costs one."""
    points, began = scattered(10, 0), [camera(0.0), camera(1.0)]
    settings = replace(SETTINGS, camera_prior=3.0, focal_prior=0.005)
    for index, one in enumerate((1 / PX, 1 / PX, 2 / PX, 1 / PX, 1 / PX, 1 / PX)):
        twist = np.zeros(6)
        twist[index] = 2.0 * one
        after = [began[0], twisted(began[1], twist)]
        state = _State(np.stack([c.rotation for c in after]), np.stack([c.translation for c in after]), points, 0.01)
        seen = seen_by([zoomed(c, np.exp(0.01)) for c in after], points)
        problem = _Problem(began, seen, True, settings)
        assert problem.cost(state, np.ones(20)) == pytest.approx((2 / 3) ** 2 + (0.01 / 0.005) ** 2, rel=1e-6)


def solved(began: list[Camera], points: np.ndarray, seen: Observations, settings: AdjustmentSettings) -> np.ndarray:
    """scipy's solution of the same problem, without our derivatives: twists [6 n] and the logarithmic zoom."""
    n, k = len(began), len(seen)
    unit = np.tile([1 / PX, 1 / PX, 2 / PX, 1 / PX, 1 / PX, 1 / PX], n) * settings.camera_prior

    def errors(x: np.ndarray) -> np.ndarray:
        cameras = [zoomed(twisted(c, x[6 * i : 6 * i + 6]), np.exp(x[6 * n])) for i, c in enumerate(began)]
        at = x[6 * n + 1 :].reshape(-1, 3)
        found = np.stack([projected(c, at) for c in cameras])
        return seen.position - found[seen.camera, seen.point]

    x = np.concatenate([np.zeros(6 * n + 1), points.ravel()])
    for _ in range(12):  # weights follow from what is left
        typical = 1.4826 * np.median(np.linalg.norm(errors(x), axis=1))
        far = np.linalg.norm(errors(x), axis=1) / (settings.outlier * typical)
        root = 1 / ((1 + far**2) * typical) / np.sqrt(settings.observations_per_fact)

        def weighted(x: np.ndarray, root: np.ndarray = root) -> np.ndarray:
            prior = [x[: 6 * n] / unit, x[6 * n : 6 * n + 1] / settings.focal_prior]
            return np.concatenate([(errors(x) * root[:, None]).ravel(), *prior])

        x = least_squares(weighted, x, method="lm" if 2 * k + 6 * n + 1 >= len(x) else "trf").x
    return np.asarray(x[: 6 * n + 1])


def test_cameras_and_focal_length_are_those_of_another_solver() -> None:
    """Photos and prior disagree, and both have a say."""
    random = np.random.default_rng(3)
    points = scattered(14, 1)
    truth = [twisted(camera(0.6 * i), np.array([0, 0, 0, 0.1 * i, -0.2 * i, 0.1 * i])) for i in range(3)]
    began = [zoomed(twisted(c, random.normal(size=6) * 0.06), 1.03) for c in truth]
    exact = seen_by(truth, points)
    seen = replace(exact, position=exact.position + random.normal(size=exact.position.shape) * 0.3)
    settings = replace(SETTINGS, camera_prior=15.0, focal_prior=0.02, observations_per_fact=1.0, iterations=60)
    settings = replace(settings, outlier=1e6)  # (else there is more than one solution)
    expected = solved(began, points, seen, settings)
    found = adjusted(began, points, seen, True, settings).cameras
    assert 0.1 < np.abs(expected[-1]) / np.log(1.03) < 0.9
    assert np.log(found[0].fx / began[0].fx) == pytest.approx(expected[-1], abs=2e-4)
    for i, (c, b) in enumerate(zip(found, began, strict=True)):
        goal = twisted(b, expected[6 * i : 6 * i + 6])
        np.testing.assert_allclose(c.translation, goal.translation, atol=2e-3)
        np.testing.assert_allclose(c.rotation, goal.rotation, atol=2e-3)


def test_weights_in_closed_form() -> None:
    """Geman and McClure's, of errors in units of the typical one: 1.4826 times the median."""
    points, c = scattered(5, 0), camera(0.0)
    off = np.array([0.5, 1.0, 2.0, 3.0, 50.0])
    error = np.array([1.0, 1.0, 2.0, 1.0, 1.0])
    seen = Observations(np.zeros(5, int), np.arange(5), projected(c, points) + np.stack([off, 0 * off], 1), error)
    settings = replace(SETTINGS, outlier=2.0, observations_per_fact=20.0)
    state = _State(c.rotation[None], c.translation[None], points, 0.0)
    found = _Problem([c], seen, False, settings).weights(state)
    typical = 1.4826 * 1.0
    far = off / error / (2.0 * typical)
    np.testing.assert_allclose(found, 1 / ((1 + far**2) * error * typical) ** 2 / 20.0, rtol=1e-6)


def test_a_zoom_that_is_fixed_does_not_move_and_what_is_left_is_a_median() -> None:
    points, cameras = scattered(40, 0), [camera(0.0), camera(1.0), camera(2.0)]
    exact = seen_by(cameras, points)
    offset = np.zeros_like(exact.position)
    offset[:, 0] = np.where(np.arange(len(offset)) % 4 == 0, 100.0, 0.0)
    result = adjusted(cameras, points, replace(exact, position=exact.position + offset), False)
    found, left = result.cameras, result.left
    assert left < 0.5, "three quarters agree"
    assert found[0].fx == pytest.approx(PX, rel=1e-9)
