"""Observations as flat arrays: who sees what, from where a patch is taken, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from dgs.core.sfm.tracks import PointTracks, ViewStack, chosen, longest, moved, normals_of, spread, tracks_of, views_of

from .models import FOCAL, model_of, pixels_of, rigid

CENTRES = [(-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
POINTS = np.array([[0.0, 0.0, 4.0], [0.5, -0.25, 5.0]])


def greys(model, height: int = 160, width: int = 200) -> dict[str, np.ndarray]:
    return {image.name: np.full((height, width), float(number), np.float32) for number, image in model.images.items()}


def tracks(point: list[int], view: list[int], points: int) -> PointTracks:
    count = len(point)
    pixels = np.arange(2.0 * count).reshape(count, 2)
    numbers = np.arange(points) + 10
    return PointTracks(np.zeros((points, 3)), np.array(point), np.array(view), pixels, np.zeros(points, int), numbers)


def views_at(centres: np.ndarray) -> ViewStack:
    count = len(centres)
    still = np.repeat(np.eye(3)[None], count, axis=0)
    images, sizes = np.zeros((count, 1, 1), np.float32), np.ones((count, 2), np.int32)
    return ViewStack(list(range(count)), images, sizes, still, -centres, centres, np.full(count, FOCAL))


def test_cameras_and_photos_are_stacked() -> None:
    model = model_of(CENTRES, POINTS)
    photos = greys(model)
    photos["0/0002.png"] = np.full((120, 240), 7.0, np.float32)
    views = views_of(model, photos)
    assert views.ids == [1, 2, 3] and views.images.shape == (3, 160, 240)
    assert views.sizes.tolist() == [[200, 160], [240, 120], [200, 160]] and views.sizes.dtype == np.int32
    assert (views.images[0, :, :200] == 1.0).all() and (views.images[0, :, 200:] == 0.0).all()
    assert (views.images[1, :120] == 7.0).all() and (views.images[1, 120:] == 0.0).all()
    assert views.focals.tolist() == [FOCAL] * 3
    np.testing.assert_allclose(views.centres, CENTRES)
    np.testing.assert_allclose(views.translations, -np.array(CENTRES))
    np.testing.assert_allclose(views.rotations, np.repeat(np.eye(3)[None], 3, axis=0), atol=1e-12)


def test_the_centre_of_a_turned_camera() -> None:
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # looks along x
    model = model_of(CENTRES[:1], POINTS)
    views = views_of(model, greys(model))
    model.images[1].frame.set_cam_from_world(1, rigid((2.0, 3.0, 5.0), turn))
    after = moved(views, model)
    np.testing.assert_allclose(after.centres, [[2.0, 3.0, 5.0]])
    np.testing.assert_allclose(after.rotations[0], turn, atol=1e-12)
    assert after.images is views.images and after.ids == [1]


def test_who_sees_which_point_where() -> None:
    model = model_of(CENTRES, POINTS, seen_by=[(3, 1, 2), (2, 3)])
    found = tracks_of(model, views_of(model, greys(model)))
    assert found.point.tolist() == [0, 0, 0, 1, 1] and found.view.tolist() == [2, 0, 1, 1, 2]
    for point, view, pixel in zip(found.point, found.view, found.pixels, strict=True):
        np.testing.assert_allclose(pixel, pixels_of(CENTRES[view], POINTS)[point])
    np.testing.assert_allclose(found.positions, POINTS)
    assert found.ids.tolist() == sorted(model.point3D_ids())


def test_a_photo_that_sees_a_point_twice_counts_once() -> None:
    model = model_of(CENTRES[:2], POINTS[:1].repeat(2, axis=0), seen_by=[(1, 2), ()])
    (number,) = [n for n in model.point3D_ids() if model.points3D[n].track.length() == 2]
    model.add_observation(number, pycolmap.TrackElement(2, 1))
    found = tracks_of(model, views_of(model, greys(model)))
    assert found.point.tolist() == [0, 0] and found.view.tolist() == [0, 1]


def test_a_model_without_points_has_no_tracks() -> None:
    model = model_of(CENTRES, np.zeros((0, 3)))
    for image in model.images.values():
        assert len(image.points2D) == 0
    found = tracks_of(model, views_of(model, greys(model)))
    assert found.positions.shape == (0, 3) and found.pixels.shape == (0, 2) and len(found.reference) == 0


def test_a_patch_is_taken_where_the_point_is_seen_straight_on() -> None:
    centres = np.array([[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    one = tracks([0, 0, 0], [0, 1, 2], 1)
    one = replace(one, positions=np.array([[0.0, 0.0, 4.0]]))
    np.testing.assert_allclose(normals_of(one, views_at(centres)), [[0.0, 0.0, -1.0]])
    model = model_of([tuple(c) for c in centres], one.positions)
    assert tracks_of(model, views_of(model, greys(model))).reference.tolist() == [1]


@pytest.mark.parametrize(("depths", "best"), [((1.0, 4.0, 16.0), 1), ((2.0, 2.5, 40.0), 1), ((40.0, 2.0, 2.2), 2)])
def test_among_views_in_a_row_the_middle_distance_is_taken(depths: tuple[float, ...], best: int) -> None:
    """All see it along one line; the logarithm of the distance decides."""
    centres = [(0.0, 0.0, 50.0 - d) for d in depths]
    model = model_of(centres, np.array([[0.0, 0.0, 50.0]]))
    logs = np.log(depths)
    assert int(np.argmin(np.abs(logs - logs.mean()))) == best
    assert tracks_of(model, views_of(model, greys(model))).reference.tolist() == [best]


def test_the_distance_weighs_less_than_the_angle() -> None:
    """30 degrees aside (cosine 0.87) are worth a distance off by a factor of 3.8: 1 - 0.2 ln f = 0.87 - 0.1 ln f."""
    for factor, straight_on in ((3.4, True), (4.3, False)):
        straight = (0.0, 0.0, -4.0 * factor)
        aside = [(s * 4.0 * np.sin(np.pi / 6), 0.0, -4.0 * np.cos(np.pi / 6)) for s in (1, -1)]
        model = model_of([straight, *aside], np.array([[0.0, 0.0, 0.0]]))
        assert (tracks_of(model, views_of(model, greys(model))).reference[0] == 0) == straight_on


def test_a_point_whose_rays_cancel_has_no_normal_and_no_nan() -> None:
    opposite = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert np.array_equal(normals_of(tracks([0, 0], [0, 1], 2), views_at(opposite)), np.zeros((2, 3)))


def test_few_observations_are_all_kept() -> None:
    few = tracks([0, 0, 1, 1], [0, 1, 0, 1], 2)
    assert longest(few, 2, 4) is few and longest(few, 2, 5) is few


def test_the_longest_tracks_are_kept_and_every_view_gets_its_share() -> None:
    # Point 0 is seen by views 0 to 3, 1 and 2 by views 0 and 1, 3 by views 4 and 5; a share is 5 / 6 of an observation.
    some = tracks([0, 0, 0, 0, 1, 1, 2, 2, 3, 3], [0, 1, 2, 3, 0, 1, 0, 1, 4, 5], 4)
    kept = longest(some, 6, 5)
    assert kept.ids.tolist() == [10, 13] and kept.point.tolist() == [0, 0, 0, 0, 1, 1]
    assert kept.view.tolist() == [0, 1, 2, 3, 4, 5] and np.array_equal(kept.pixels, some.pixels[[0, 1, 2, 3, 8, 9]])


def test_half_as_many_again_are_the_most() -> None:
    # 20 points, each seen by two views of its own: every view could have its share of two.
    point = np.repeat(np.arange(20), 2).tolist()
    kept = longest(tracks(point, list(range(40)), 20), 40, 8)
    assert len(kept.positions) == 6 and len(kept.point) == 12  # 1.5 * 8
    assert kept.ids.tolist() == [10, 11, 12, 13, 14, 15]


def test_a_part_of_each_photos_observations_evenly() -> None:
    view = np.array([0] * 10 + [1] * 4 + [0] * 2)
    some = replace(tracks([0] * 16, [0] * 16, 1), view=view)
    among = np.ones(16, bool)
    among[:2] = False  # leaves 10 of view 0
    keep = spread(some, among, 5)
    assert np.flatnonzero(keep).tolist() == [2, 4, 6, 8, 10, 11, 12, 13, 14]
    assert np.array_equal(spread(some, among, 10), among)
    assert not spread(some, np.zeros(16, bool), 5).any()


def test_points_that_one_photo_is_left_of_are_gone() -> None:
    some = tracks([0, 0, 1, 1, 1, 2, 2], [0, 1, 0, 1, 2, 0, 2], 3)
    kept = chosen(some, np.array([True, False, True, True, False, True, True]))
    assert kept.ids.tolist() == [11, 12] and kept.point.tolist() == [0, 0, 1, 1]
    assert kept.view.tolist() == [0, 1, 0, 2] and np.array_equal(kept.pixels, some.pixels[[2, 3, 5, 6]])
    assert len(kept.positions) == len(kept.reference) == 2
