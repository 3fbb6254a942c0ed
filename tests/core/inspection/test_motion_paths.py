"""Every photo's own motion path: length and direction estimated, nothing invented, and no haze because of it."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.benchmarks.effect_scenes import Truth, own_paths
from dgs.core.effects import haze
from dgs.core.effects.registry import built
from dgs.core.inspection.haze_fit import fit_haze
from dgs.core.inspection.motion_paths import MotionPath, MotionPathFinder, SetMotion
from dgs.core.inspection.observations import SETTINGS, _narrowed, observe_points
from dgs.core.inspection.photo_set import PhotoSet


@pytest.mark.parametrize("length", [6.0, 12.0])
def test_lengths_and_directions_are_estimated(taken, scene, length):
    photos = taken(motion=length)
    truth = own_paths(Truth(motion=length), scene, 1)
    paths = [photos.motion_paths[photo.name] for photo in photos.photos]
    found = np.array([path.length for path in paths])
    assert (found > 0).all()
    assert np.median(np.abs(found / truth[:, 0] - 1)) < 0.03
    off = (np.array([path.angle for path in paths]) - truth[:, 1] + 90) % 180 - 90
    assert np.median(np.abs(off)) < 3.0
    errors = np.array([path.error for path in paths])
    assert (np.abs(found - truth[:, 0]) < 4 * errors).mean() > 0.7 and (errors < 0.2 * found).all()
    motion, lenses = built("motion", photos), photos.cameras.lenses
    assert set(motion.names) == {photo.name for photo in photos.photos}
    lengths = [motion.length(name, lenses[name].fx) for name in motion.names]
    assert np.median(lengths) == pytest.approx(length, rel=0.3)
    photo = photos.photos[0].name
    way, angle = motion.way(photo, lenses[photo].fx), np.radians(photos.motion_paths[photo].angle)
    straight = (way[-1] - way[0]).numpy()
    assert straight / np.linalg.norm(straight) == pytest.approx([np.cos(angle), np.sin(angle)], abs=1e-4)


def test_photos_that_did_not_move_have_no_path(taken):
    for photos in (taken(), taken(psf=(3.0, 1.5, 30.0))):  # a blur that all share is no motion of single photos
        assert max(path.length for path in photos.motion_paths.values()) == 0.0
        motion = built("motion", photos)
        assert max(motion.length(name, 500.0) for name in motion.names) == 0.0
        assert not photos.motion.significant


def test_another_photo_is_judged_against_the_common_spectrum(taken):
    photos = taken(motion=8.0)
    finder = MotionPathFinder(photos.photos[:-1], photos.rounding)
    last = photos.photos[-1]
    assert finder.path(last).length == pytest.approx(photos.motion_paths[last.name].length, rel=0.1)


@pytest.mark.parametrize(
    ("whole", "lengths", "certain"),
    [
        ((9.0, 1.0), [0.0] * 10, True),  # all together
        ((11.8, 4.4), [44.0, 19.0, 17.0, 12.0] + [0.0] * 6, True),  # the longest leaves their rms uncertain
        ((11.8, 4.4), [44.0, 19.0] + [0.0] * 8, False),  # one in five may be wrong
        ((4.0, 0.5), [4.0] * 10, False),  # each a little longer than what shows
    ],
)
def test_what_is_beyond_doubt(whole, lengths, certain):
    paths = {f"{index}.png": MotionPath(length, 0.3 if length < 40.0 else 10.0) for index, length in enumerate(lengths)}
    found = SetMotion(*whole, paths)
    assert found.certain is certain


def test_photos_without_detail_or_company_tell_nothing(taken):
    photos = taken()
    grey = [replace(p, pixels=np.full_like(p.pixels, 90)) for p in photos.photos]
    assert PhotoSet(grey).motion is None and PhotoSet(grey).motion_paths == {}
    assert PhotoSet(photos.photos[:3]).motion is None


@pytest.mark.parametrize("light", [0.0, 1.0 / 16.0])
def test_a_photo_that_is_black_among_others_has_no_path_and_changes_none(taken, light):
    photos = taken(motion=8.0)
    dark = np.random.default_rng(0).normal(light * photos.photos[0].pixels.mean(), 0.6, photos.photos[0].pixels.shape)
    black = replace(photos.photos[0], name="black", pixels=dark.clip(0, 255).round().astype(np.uint8))
    found = PhotoSet([*photos.photos, black]).motion_paths
    assert found["black"].length == 0.0
    for name, path in photos.motion_paths.items():
        assert found[name].length == pytest.approx(path.length, rel=0.02)


def test_motion_is_not_taken_for_haze(taken):
    assert taken(motion=8.0).motion.significant and not haze.inspect(taken(motion=8.0)).needed
    assert haze.inspect(taken(haze=0.4)).needed
    photos, own = taken(motion=8.0), {n: (p.length, p.angle) for n, p in taken(motion=8.0).motion_paths.items()}
    estimated = [
        fit_haze(observe_points(photos.photos, photos.cameras, photos.sigma, paths=paths)).attenuation.mean()
        for paths in ({}, own)
    ]
    assert abs(estimated[1]) < 0.6 * abs(estimated[0])  # windows of equal blur see less of a haze that is not there


def test_a_window_is_narrower_along_its_photo_s_path():
    t = np.arange(-4, 5)
    x, y = (grid.ravel() for grid in np.meshgrid(t, t))
    window = np.exp(-0.5 * (x**2 + y**2) / (SETTINGS.window_share * 4) ** 2)
    narrow = _narrowed(window / window.sum(), np.array([8.0, 90.0]), np.array([2.0, 4.0]))
    assert narrow.sum(axis=1) == pytest.approx(1.0)
    variance = (narrow * y**2).sum(axis=1)
    assert (narrow * x**2).sum(axis=1) == pytest.approx([3.1, 3.1], rel=0.05)
    # In samples^2: what the path takes, 64 / 12 px^2, over the step squared.
    assert variance == pytest.approx(1.8**2 - 64 / 12 / np.array([4.0, 16.0]), rel=0.1)
