"""Guesses where nobody confirms a depth: between what is known, and nowhere that a photo looks through."""

import numpy as np
import pytest
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.surface.find import SETTINGS, surface_points
from dgs.core.surface.guess import guessed_from, unconfirmed, unhidden
from dgs.core.surface.stack import ViewStack, stack_views
from dgs.core.surface.sweep import DepthMap
from dgs.tests.core.surface.scenes import BEHIND, DrawnScene, arc, drawn


@pytest.fixture(scope="module")
def wall() -> tuple[DrawnScene, ViewStack]:
    """A plane, and nothing else."""
    scene = drawn(arc(9), ball=False)
    return scene, stack_views(scene.photos, scene.cameras, Medium())


def _known(scene: DrawnScene, view: int, columns: slice) -> DepthMap:
    """A map that is right in some columns and empty elsewhere."""
    truth = scene.depths[view]
    depth = np.zeros(truth.shape, np.float32)
    depth[:, columns] = truth[:, columns]
    return DepthMap(view, depth, (depth > 0).astype(np.float32))


def test_between_known_px_and_points_a_plane_is_a_plane(wall) -> None:
    scene, views = wall
    truth = scene.depths[4]
    one = _known(scene, 4, slice(0, 30))
    right = views.lifted(4, np.array([[90.5, 10.5], [90.5, 60.5]]), truth[[10, 60], 90])
    guess = guessed_from(one, right, views)
    assert guess is not None
    middle = np.s_[15:55, 30:85]
    assert np.abs(guess[middle] / truth[middle] - 1).max() < 0.01
    assert (guess > 0).all()  # beside all that is known, too
    assert guessed_from(_known(scene, 4, slice(0, 0)), right, views) is None


def test_a_guess_before_a_confirmed_surface_is_dropped(wall) -> None:
    scene, views = wall
    checked = [_known(scene, view, slice(None)) for view in range(9) if view != 4] + [_known(scene, 4, slice(0, 30))]
    true, near = (unconfirmed([None] * 8 + [scene.depths[4] * k], checked, views, None) for k in (1.0, 0.6))
    there = true[8].depth > 0
    assert there[:, 31:].any() and not there[:, :30].any() and all(not one.depth.any() for one in true[:8])
    # (what others see less than 3 % behind a guess does not contradict it)
    assert there.sum() > 5 * (near[8].depth > 0).sum()


def test_what_shows_no_depth_is_faint_and_stands_between_what_does(tmp_path) -> None:
    """A ball before a plain wall: the wall is guessed between the ball's px and beside them, before nothing."""
    scene = drawn(arc(6), (128, 96), 133.0, plain=True)
    points = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, Silent()).points
    assert points.confidence is not None
    guessed = points.confidence == np.float32(SETTINGS.guessed)
    assert guessed.sum() > 500 and (points.positions[guessed, 2] < BEHIND + 1.0).all()


def test_points_behind_an_object_are_no_surface_of_its_front():
    """A far side between near points is hidden; a wall beside a post is not, nor what one false point is before."""
    x, y = (plane.ravel() for plane in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    pixels = np.stack([4 * x, 4 * y], axis=1)
    far = (x + y) % 2 == 1
    front = unhidden(pixels, np.where(far, 6.0, 4.0), 100.0)
    inside = (x > 0) & (x < 19) & (y > 0) & (y < 19)
    assert front[~far].all() and not front[far & inside].any()
    assert unhidden(pixels, np.where(x < 3, 2.0, 6.0), 100.0).all()
    assert unhidden(pixels, np.where((x == 9) & (y == 9), 1.0, 6.0), 100.0).all()
    assert unhidden(pixels, 6.0 * np.exp(-0.1 * y), 100.0).all()
    assert unhidden(pixels[:3], np.array([1.0, 2.0, 3.0]), 100.0).all()
