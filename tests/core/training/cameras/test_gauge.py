"""Where the world lies after an adjustment: where the cameras of before see it."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import Similarity, align_similarity
from dgs.core.training.cameras.bundle import Adjusted, Observations, aligned_camera
from dgs.core.training.cameras.gauge import as_first_seen
from dgs.core.training.cameras.pose_steps import twisted
from scipy.spatial.transform import Rotation

FOCAL = 600.0


def rail(count: int = 12) -> list[Camera]:
    """Cameras on a patch before a scene 10 units away, all looking ahead of them."""
    random = np.random.default_rng(0)
    cameras = []
    for index in range(count):
        centre = np.array([*random.uniform(-1.5, 1.5, 2), -10.0])
        turn = Rotation.from_rotvec([-centre[1] / 10, centre[0] / 10, 0.0]).as_matrix().T
        cameras.append(Camera(str(index), 480, 320, FOCAL, FOCAL, 240.0, 160.0, turn, -turn @ centre))
    return cameras


@pytest.fixture(scope="module")
def surface():
    return np.random.default_rng(1).normal(size=(200, 3))


def everywhere(cameras, points) -> Observations:
    """Every camera sees every point."""
    camera, point = (each.ravel() for each in np.mgrid[: len(cameras), : len(points)])
    nothing = np.zeros((len(camera), 2))
    return Observations(camera, point, nothing, np.ones(len(camera)))


def seen(camera, points):
    local = points @ camera.rotation.T + camera.translation
    return local[:, :2] / local[:, 2:] * camera.fx


def off_px(first, world: Similarity, found: Adjusted) -> float:
    """px, median, by which the first cameras see the points beside where the adjusted cameras see them."""
    points = world.points(found.points)
    beside = [seen(a, points) - seen(b, found.points) for a, b in zip(first, found.cameras, strict=True)]
    return float(np.median(np.linalg.norm(beside, axis=2)))


def by_centres(first, found: Adjusted) -> Similarity:
    return align_similarity({c.name: c for c in found.cameras}, {c.name: c for c in first})


def turned_in(first, points) -> Adjusted:
    """Cameras that stay where they are and turn to a surface that is thought to be nearer by a fiftieth."""
    middle = np.mean([camera.centre for camera in first], axis=0)
    nearer = middle + 0.98 * (points - middle)
    cameras = []
    for camera in first:
        free = aligned_camera(camera, nearer, seen(camera, points), np.ones(len(points)))
        cameras.append(free.moved(free.rotation, -free.rotation @ camera.centre))
    return Adjusted(cameras, nearer, 0.0)


def test_a_similarity_is_undone(surface):
    first = rail()
    moved = Similarity(1.7, Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([3.0, -1.0, 2.0]), 3)
    found = Adjusted([moved.camera(camera) for camera in first], moved.points(surface), 0.0)
    back = as_first_seen(first, found, everywhere(first, surface))
    assert np.allclose(back.points(found.points), surface, atol=1e-9)
    for camera, at in zip(first, found.cameras, strict=True):
        assert np.allclose(back.camera(at).centre, camera.centre, atol=1e-8)


def test_cameras_that_turn_inwards_see_the_world_where_it_was(surface):
    """Their centres say that nothing has moved: laid by them, the first cameras see the twin beside its place."""
    first = rail()
    found = turned_in(first, surface)
    world = as_first_seen(first, found, everywhere(first, surface))
    beside = off_px(first, by_centres(first, found), found)
    assert beside > 1.0
    assert off_px(first, world, found) < 0.3 * beside


def test_a_camera_that_was_far_off_moves_the_world_little(surface):
    true = rail()
    first = [twisted(true[0], np.array([0.0, 0.0, 0.0, 0.08, 0.0, 0.0])), *true[1:]]
    found = Adjusted(true, surface, 0.0)
    world = as_first_seen(first, found, everywhere(first, surface))
    assert off_px(true[1:], world, replace(found, cameras=true[1:])) < 0.05
    assert off_px(true[1:], by_centres(first, found), replace(found, cameras=true[1:])) > 1.0


def test_points_behind_a_first_camera_say_nothing(surface):
    true = rail()
    turned = Rotation.from_rotvec([0.0, np.pi, 0.0]).as_matrix() @ true[0].rotation
    first = [true[0].moved(turned, -turned @ true[0].centre), *true[1:]]
    found = Adjusted(true, surface, 0.0)
    world = as_first_seen(first, found, everywhere(first, surface))
    assert off_px(true[1:], world, replace(found, cameras=true[1:])) < 1e-6
