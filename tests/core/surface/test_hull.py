"""The visual hull of a ball, and samples on it; one even set from many samples."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.background import Background
from dgs.core.imaging.medium import Medium
from dgs.core.surface.hull import EMPTY, FILLED, HullSettings, carved_hull
from dgs.core.surface.hull_points import hull_samples
from dgs.core.surface.stack import StackSettings, stack_views
from dgs.core.surface.sweep import DepthMap
from dgs.core.surface.union import Samples, merged_in
from dgs.tests.core.surface.scenes import RADIUS, arc, around, drawn, texture

COARSE = HullSettings(cells=(16, 32, 64))


@pytest.fixture(scope="module")
def scene():
    return drawn(around(24), plane=False)


@pytest.fixture(scope="module")
def views(scene):
    return stack_views(scene.photos, scene.cameras, Medium())


@pytest.fixture(scope="module")
def hull(views):
    return carved_hull(views, COARSE)


def test_the_hull_of_a_ball_is_nearly_the_ball(views, hull):
    """No more than a px or two outside of it, nothing of it carved away."""
    assert hull.bounded
    radius = np.linalg.norm(hull.middles(hull.states == FILLED), axis=1)
    px = 5.0 / views.focals[0]
    assert radius.max() < 1.12 * RADIUS + 2 * px  # between 24 silhouettes a little more is left than the ball
    inside = np.random.default_rng(0).normal(size=(2000, 3))
    inside *= (0.97 * RADIUS - px) / np.linalg.norm(inside, axis=1, keepdims=True)
    assert (hull.at(inside) == FILLED).all()
    surface = np.linalg.norm(hull.surface(), axis=1)
    assert abs(np.median(surface) - RADIUS) < 2 * px
    assert (hull.at(2.0 * inside) == EMPTY).mean() > 0.5
    near, far = hull.near_far(views, 0)
    assert 3.7 < near < 4.1 and 5.9 < far < 6.3


def test_one_photo_that_errs_does_not_carve_the_object_away(views):
    empty = views.empty.copy()
    empty[3] = True
    hull = carved_hull(replace(views, empty=empty), COARSE)
    inside = np.random.default_rng(0).uniform(-0.5, 0.5, (500, 3))
    assert (hull.at(inside) == FILLED).all()


def test_photos_without_anything_empty_have_no_hull(views):
    assert carved_hull(replace(views, empty=None)) is None
    assert carved_hull(replace(views, empty=np.zeros_like(views.empty))) is None
    assert carved_hull(replace(views, empty=np.ones_like(views.empty))) is None  # nothing is left


def test_a_wall_behind_is_no_object():
    """Half of each photo is transparent, but what is left goes on behind the frames."""
    scene = drawn(arc(6), (48, 36), 50.0)
    views = stack_views(scene.photos, scene.cameras, Medium())
    empty = np.zeros_like(views.counts)
    empty[:, :10] = True
    hull = carved_hull(replace(views, empty=empty), COARSE)
    assert hull is not None and not hull.bounded


def test_samples_of_the_hull_have_the_objects_colours(scene, views, hull):
    samples = hull_samples(hull, views, [], 0.05)
    assert len(samples) > 500 and (samples.confidence == np.float32(0.05)).all()
    on = samples.positions / np.linalg.norm(samples.positions, axis=1, keepdims=True)
    truth = 255 * texture(on, 2)
    off = np.abs(samples.colours - truth).mean(axis=1)
    assert np.median(off) < 25 < np.median(np.abs(truth - truth.mean(0)).mean(1)) + 25
    assert np.corrcoef(samples.colours[:, 0], truth[:, 0])[0, 1] > 0.6
    # What a view looks through is not kept: a map that sees only what is far behind takes away what it faces.
    far = DepthMap(0, np.full(views.counts.shape[1:], 9.0, np.float32), np.ones(views.counts.shape[1:], np.float32))
    fewer = hull_samples(hull, views, [far], 0.05)
    facing = fewer.positions @ views.centres[0] > 0
    assert len(fewer) < len(samples) and not facing.any()


def _samples(positions, colour=100, confidence=0.5, spacing=0.01):
    n = len(positions)
    return Samples(
        np.asarray(positions, float),
        np.full((n, 3), colour, np.uint8),
        np.full(n, confidence, np.float32),
        np.full(n, spacing),
    )


def test_many_samples_become_one_point_for_each_cell():
    noise = np.random.default_rng(2)
    dense = np.concatenate([noise.uniform(0, 1, (20000, 2)), 0.1 * noise.uniform(0, 1, (20000, 2))])
    samples = [_samples(np.c_[dense, np.zeros(len(dense))])]
    points = merged_in(samples, 4.0)
    assert 900 < len(points.positions) <= 33**2
    # As many per area in the crowded corner as elsewhere.
    corner = (points.positions[:, :2] < 0.1).all(1).sum() / 0.01
    assert 0.5 < corner / (len(points.positions) / 1.0) < 2.0
    assert points.confidence is not None and points.confidence.dtype == np.float32
    fewer = merged_in(samples, 4.0, 300)
    np.testing.assert_array_equal(fewer.positions, points.positions[:300])
    # ... which are from everywhere.
    assert (np.histogram2d(*fewer.positions[:, :2].T, bins=3, range=[[0, 1], [0, 1]])[0] > 15).all()


def test_things_at_hand_keep_their_points_before_a_far_horizon():
    """A grid of 1 mm at hand, and hills 20 km off on all sides: as many points at hand as without the hills."""
    hand = np.stack(np.meshgrid(np.arange(40) * 1e-3, np.arange(40) * 1e-3, [1.0]), -1).reshape(-1, 3)
    turn = np.linspace(0, 2 * np.pi, 30)
    hills = 2e4 * np.stack([np.cos(turn), np.sin(turn), np.sin(3 * turn)], axis=1)
    near = _samples(hand, 200, 0.9, 1e-3)
    points = merged_in([near, _samples(hills, 50, 0.1, 80.0)], 1.0)
    at_hand = np.linalg.norm(points.positions, axis=1) < 10
    assert at_hand.sum() == len(merged_in([near], 1.0).positions) and (points.colours[at_hand] == 200).all()
    assert (~at_hand).sum() == len(hills) - 1  # the circle's first and last are one


def test_worse_samples_count_only_where_no_better_ones_are():
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), -1).reshape(-1, 3)
    better = _samples(grid[grid[:, 0] < 10], 200, 0.9, 1.0)
    worse = _samples(grid + 0.01, 50, 0.1, 1.0)
    points = merged_in([better, worse], 0.5)
    left = points.positions[:, 0] < 9
    assert (points.colours[left] == 200).all() and (points.confidence[left] == np.float32(0.9)).all()
    right = points.positions[:, 0] > 12
    assert right.any() and (points.colours[right] == 50).all()


def test_a_cell_has_the_median_colour_and_the_weighted_place():
    parts = Samples(
        np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]]),
        np.array([[10, 0, 0], [20, 0, 0], [250, 0, 0]], np.uint8),
        np.array([0.2, 0.2, 0.6], np.float32),
        np.full(3, 1.0),
    )
    points = merged_in([parts], 0.5)
    assert points.colours.tolist() == [[20, 0, 0]] and points.confidence.tolist() == [np.float32(0.6)]
    np.testing.assert_allclose(points.positions, [[0.14, 0, 0]], rtol=1e-6)
    assert len(merged_in([_samples(np.zeros((0, 3)))], 0.5).positions) == 0


def test_a_wire_thinner_than_a_small_px_is_not_empty():
    """A wire one px wide in photos five times as large as the small views: with alpha, and on a plain background."""
    scene = drawn(around(8), (240, 180), 250.0, plane=False)
    wired, plain = [], []
    for photo in scene.photos:
        pixels, alpha = photo.pixels.copy(), photo.alpha.copy()
        pixels[alpha == 0] = 255
        pixels[:, 23], alpha[:, 23] = 30, 255
        wired.append(replace(photo, pixels=pixels, alpha=alpha))
        plain.append(replace(photo, pixels=pixels, alpha=None, background=Background(tolerance=0.01)))
    for photos in (wired, plain):
        views = stack_views(photos, scene.cameras, Medium(), StackSettings(longest_side=48))
        assert not views.empty[:, :, 4].any() and views.empty[:, 10, 5].all()
