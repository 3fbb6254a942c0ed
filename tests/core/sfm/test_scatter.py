"""Points that stand in where cameras came without any: where they lie, and what colour they have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.lens import Lens
from dgs.core.photos.load import Photo
from dgs.core.pose import Pose
from dgs.core.reconstruction import Figures, Reconstruction, no_points
from dgs.core.sfm.scatter import SETTINGS, closest_point, scattered_points

FEW = replace(SETTINGS, count=400)


def photo(name: str, pixels: np.ndarray) -> Photo:
    return Photo(name, Path(name), pixels)


def known(*poses: Pose) -> Reconstruction:
    lens = Lens("PINHOLE", 40, 20, (50.0, 60.0, 18.0, 11.0))
    names = [f"{i}.png" for i in range(len(poses))]
    figures = Figures("given", len(poses), len(poses), 50.0, 0.0, 0.0, 0.0)
    return Reconstruction(dict(zip(names, poses, strict=True)), dict.fromkeys(names, lens), no_points(), figures)


#: Looks along x instead of z.
SIDEWAYS = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def test_axes_that_meet_meet_there() -> None:
    centres = np.array([[0.0, 0.0, -5.0], [-5.0, 0.0, 0.0], [0.0, 7.0, 0.0]])
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    exact = replace(SETTINGS, parallel_prior=1e-12)
    np.testing.assert_allclose(closest_point(centres + [1, 2, 3], axes, exact), [1.0, 2.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(closest_point(centres + [1, 2, 3], axes), [1.0, 2.0, 3.0], atol=0.02)


def test_axes_that_pass_each_other_are_met_halfway() -> None:
    centres, axes = np.array([[0.0, 1.0, -5.0], [-5.0, -1.0, 0.0]]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    exact = replace(SETTINGS, parallel_prior=1e-12)
    np.testing.assert_allclose(closest_point(centres, axes, exact), [0.0, 0.0, 0.0], atol=1e-9)


def test_parallel_axes_meet_a_spread_ahead() -> None:
    """Root mean square distance from the middle: 2; three times that ahead."""
    centres, axes = np.array([[-2.0, 1.0, 0.0], [2.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 1.0]] * 2)
    np.testing.assert_allclose(closest_point(centres, axes), [0.0, 1.0, 6.0], atol=1e-6)
    one = closest_point(np.array([[4.0, 5.0, 6.0]]), axes[:1])  # no spread: three units ahead
    np.testing.assert_allclose(one, [4.0, 5.0, 9.0], atol=1e-6)


def test_the_guess_ahead_weighs_a_thousandth_of_a_camera() -> None:
    """Two axes that meet at the origin: the guess weighs 0.002 against the one camera that looks across."""
    centres, axes = np.array([[0.0, 0.0, -5.0], [-5.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    spread = np.sqrt(12.5)
    guess = np.array([-2.5, 0.0, -2.5]) + 3.0 * spread * np.array([0.5, 0.0, 0.5])
    np.testing.assert_allclose(closest_point(centres, axes), 0.002 * guess / 1.002 * [1, 0, 1], rtol=1e-9)


def test_points_lie_in_what_each_photo_shows_and_have_its_colour() -> None:
    """Two cameras whose axes meet 10 before each; every px of a photo names itself."""
    row, column = np.mgrid[:20, :40]
    eight = np.stack([column, row, np.full_like(row, 7)], axis=2).astype(np.uint8)
    sixteen = np.stack([column, row, np.full_like(row, 9)], axis=2).astype(np.uint16) * np.uint16(257)
    cameras = known(Pose(np.eye(3), np.array([0.0, 0.0, 10.0])), Pose(SIDEWAYS, np.array([0.0, 0.0, 10.0])))
    points = scattered_points(cameras, [photo("1.png", sixteen), photo("0.png", eight)], 3, FEW)
    assert points.positions.shape == points.colours.shape == (400, 3)
    given = list(cameras.cameras().values())
    focus = closest_point(np.array([c.centre for c in given]), np.array([c.rotation[2] for c in given]))
    for at, (name, third) in enumerate((("0.png", 7), ("1.png", 9))):
        camera = cameras.cameras()[name]
        local = points.positions[at::2] @ camera.rotation.T + camera.translation
        ahead = (camera.rotation @ focus + camera.translation)[2]
        share = local[:, 2] / ahead
        assert 0.6 <= share.min() < 0.62 and 1.48 < share.max() <= 1.5
        x, y = local[:, 0] / local[:, 2] * 50.0 + 18.0, local[:, 1] / local[:, 2] * 60.0 + 11.0
        assert 0 <= x.min() < 1 and 39 < x.max() <= 40 and 0 <= y.min() < 1 and 19 < y.max() <= 20
        wanted = np.stack([np.floor(x + 1e-9), np.floor(y + 1e-9), np.full(200, third)], axis=1)
        assert (points.colours[at::2] == wanted).all()


def test_a_seed_decides() -> None:
    cameras = known(Pose(np.eye(3), np.zeros(3)))
    photos = [photo("0.png", np.zeros((20, 40, 3), np.uint8))]
    first, same, other = (scattered_points(cameras, photos, seed, FEW).positions for seed in (0, 0, 1))
    assert np.array_equal(first, same) and not np.array_equal(first, other)
    assert len(scattered_points(cameras, photos).positions) == SETTINGS.count == 5000


@pytest.mark.parametrize(("ahead", "depth"), [(0.4, 5.0), (0.6, 0.6)])
def test_who_looks_past_the_scene_takes_its_distance(ahead: float, depth: float) -> None:
    """A camera 5 from where the others look, which lies before it by less than a tenth of that, or by more."""
    aside = np.sqrt(25.0 - ahead**2)
    cross = [Pose(turn, np.array([0.0, 0.0, 10.0])) for turn in (np.eye(3), SIDEWAYS)]
    cameras = known(*cross * 100, Pose(np.eye(3), np.array([aside, 0.0, ahead])))
    blank = [photo(f"{i}.png", np.zeros((20, 40, 3), np.uint8)) for i in range(201)]
    points = scattered_points(cameras, blank, 0, replace(SETTINGS, count=201, nearest=1.0, farthest=1.0))
    assert points.positions[200, 2] + ahead == pytest.approx(depth, rel=0.05)
