"""Surfaces around points that cameras come with, on scenes whose depth is known."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core import compiled
from dgs.core.errors import Cancelled
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.surface.choice import ChoiceSettings, neighbours_of
from dgs.core.surface.guess import GuessSettings
from dgs.core.surface.seeded import SETTINGS, seeded_surface
from dgs.core.surface.stack import stack_views
from dgs.core.surface.sweep import Around, SweepSettings, swept
from dgs.core.views import SparsePoints
from dgs.tests.core.surface.scenes import RADIUS, arc, around, drawn

NONE = Medium()


def with_points(scene, count: int = 60):
    """The scene's cameras with a few true points, as structure from motion gives them."""
    views = stack_views(scene.photos, scene.cameras, NONE)
    random, found = np.random.default_rng(0), []
    for index in random.integers(0, len(views), count):
        there = np.argwhere(np.isfinite(scene.depths[index]))
        row, column = there[random.integers(len(there))]
        depth = np.array([scene.depths[index][row, column]])
        found.append(views.lifted(int(index), np.array([[column + 0.5, row + 0.5]]), depth)[0])
    points = SparsePoints(np.array(found), np.full((count, 3), 128, np.uint8))
    return replace(scene.cameras, points=points), views


@pytest.fixture(scope="module")
def wall():
    return drawn(arc(9))


def off_the_truth(positions: np.ndarray, scene, views, view: int) -> np.ndarray:
    """Depth over the true one less 1 of the positions inside a view's frame."""
    pixels, depth = views.depths(view, positions)
    column, row = pixels.astype(int).T
    return depth / scene.depths[view][row, column] - 1


def test_a_guess_that_is_wrong_by_a_sixth_is_mended(wall):
    """The planes follow the guess, whatever its shape; depths beyond the band are not found."""
    cameras, views = with_points(wall)
    truth = wall.depths[4]
    others = neighbours_of(4, views, 3.0, 9.0, ChoiceSettings(neighbours=2))
    bend = 1 + 0.16 * np.sin(np.linspace(0, 6, truth.shape[1]))
    found = swept(4, views, others, Around(truth * bend, 0.25), views.counts[4], settings=SweepSettings(planes=24))
    sure = found.confidence > 0.3
    error = np.abs(found.depth / truth - 1)[sure]
    assert sure.mean() > 0.3 and np.median(error) < 0.004 and (error < 0.015).mean() > 0.9
    beyond = swept(4, views, others, Around(truth * 1.5, 0.25), views.counts[4], settings=SweepSettings(planes=24))
    assert (beyond.depth[beyond.depth > 0] > 1.15 * np.broadcast_to(truth, truth.shape)[beyond.depth > 0]).all()


def test_samples_lie_on_the_surfaces_between_the_points(wall):
    cameras, views = with_points(wall)
    found = seeded_surface(wall.photos, cameras, NONE, Silent())
    assert found is not None and 0.4 < found.share <= 1
    samples = found.samples
    assert samples.confidence is not None and len(samples.positions) > 5000
    sure = samples.confidence > 0.6
    error = np.abs(np.concatenate([off_the_truth(samples.positions[sure], wall, views, view) for view in (0, 4, 8)]))
    # (what a view does not see lies behind what it sees)
    assert sure.sum() > 2000 and np.median(error) < 0.005 and (error < 0.02).mean() > 0.8
    near = np.concatenate([off_the_truth(samples.positions, wall, views, view) for view in (0, 4, 8)])
    assert (near < -0.1).mean() < 0.02, "nothing floats before the surfaces"


def test_a_thing_that_no_point_lies_on_is_found_before_the_wall(wall):
    """Structure from motion found points on the wall alone, whose band of depths does not reach the ball."""
    cameras, views = with_points(wall, 400)
    on_wall = np.linalg.norm(cameras.points.positions, axis=1) > 1.2 * RADIUS
    cameras = replace(cameras, points=cameras.points.chosen(on_wall))
    found = seeded_surface(wall.photos, cameras, NONE, Silent())
    assert found is not None and found.samples.confidence is not None
    sure = found.samples.positions[found.samples.confidence > 0.4]
    radius = np.linalg.norm(sure, axis=1)
    assert (np.abs(radius / RADIUS - 1) < 0.05).sum() > 150
    assert ((radius < 0.9 * RADIUS) & (radius > 0)).mean() < 0.02


def test_nothing_is_lifted_where_photos_are_empty():
    scene = drawn(around(20), (96, 72), 110.0, plane=False)
    cameras, _ = with_points(scene, 150)
    found = seeded_surface(scene.photos, cameras, NONE, Silent())
    assert found is not None
    radius = np.linalg.norm(found.samples.positions, axis=1)
    assert found.samples.confidence is not None
    sure = found.samples.confidence > 0.6
    assert sure.sum() > 500 and (np.abs(radius[sure] / RADIUS - 1) < 0.05).mean() > 0.95
    # (the hull's cells are a seventeenth of the radius)
    assert (radius < 1.06 * RADIUS).mean() > 0.99 and radius.max() < 1.15 * RADIUS


def test_photos_that_show_no_depth_confirm_nothing():
    blank = drawn(arc(5), ball=False, plain=True)
    cameras, _ = with_points(blank)
    assert seeded_surface(blank.photos, cameras, NONE, Silent()) is None


def test_points_that_no_view_sees_are_no_guess(wall):
    few = replace(wall.cameras, points=SparsePoints(np.zeros((3, 3)), np.zeros((3, 3), np.uint8)))
    assert seeded_surface(wall.photos, few, NONE, Silent()) is None


def test_one_photo_or_none_confirms_nothing(wall):
    cameras, _ = with_points(wall)
    assert seeded_surface(wall.photos[:1], cameras, NONE, Silent()) is None
    assert seeded_surface([], cameras, NONE, Silent()) is None


def test_the_same_photos_give_the_same_samples_and_a_user_may_stop(wall):
    cameras, _ = with_points(wall)
    one, two = (seeded_surface(wall.photos, cameras, NONE, Silent()) for _ in range(2))
    assert one is not None and two is not None
    np.testing.assert_array_equal(one.samples.positions, two.samples.positions)
    np.testing.assert_array_equal(one.samples.confidence, two.samples.confidence)

    class Stopped(Silent):
        def cancelled(self) -> bool:
            return True

    with pytest.raises(Cancelled):
        seeded_surface(wall.photos, cameras, NONE, Stopped())


def test_many_points_are_thinned_before_they_make_a_guess(wall):
    cameras, views = with_points(wall, 4000)
    every, some = (
        seeded_surface(wall.photos, cameras, NONE, Silent(), replace(SETTINGS, guess=GuessSettings(most_points=count)))
        for count in (10**6, 200)
    )
    assert every is not None and some is not None
    assert abs(every.share - some.share) < 0.1


def test_threads_change_nothing(wall):
    cameras, _ = with_points(wall)
    found, before = [], compiled.threads()
    try:
        for count in (1, 5):
            compiled.set_threads(count)
            surface = seeded_surface(wall.photos, cameras, NONE, Silent())
            assert surface is not None
            found.append(surface.samples)
    finally:
        compiled.set_threads(before)
    for one, other in zip(vars(found[0]).values(), vars(found[1]).values(), strict=True):
        np.testing.assert_array_equal(one, other)
