"""The compiled parts of inspection against numpy's."""

import numpy as np
from dgs.core.inspection import surface_bands
from dgs.core.inspection.band_kernels import interpolate
from dgs.core.inspection.local_blur import SETTINGS as LOCAL
from dgs.core.inspection.local_blur import _binned
from dgs.core.inspection.path_kernels import straight_shares


def test_straight_paths_leave_the_square_of_a_sinc():
    random = np.random.default_rng(0)
    fx, fy = random.uniform(-0.5, 0.5, (2, 50, 12))
    fx[0, 0], fy[0, 0] = 0.0, 0.0
    x, y = np.r_[0.0, random.uniform(-60, 60, 20)], np.r_[0.0, random.uniform(-60, 60, 20)]
    found = np.empty((len(x), len(fx)))
    straight_shares(0, len(x), x, y, fx, fy, found)
    wanted = (np.sinc(x[:, None, None] * fx + y[:, None, None] * fy) ** 2).mean(axis=2)
    assert np.abs(found - wanted).max() < 1e-10


def test_interpolation_is_numpy_s_at_places_between_and_beyond():
    at = np.r_[np.linspace(0.0, 4.0, 30), np.linspace(4.3, 60.0, 50)]
    values, x = np.cos(at), np.r_[at, np.random.default_rng(0).uniform(-1, 70, 500), np.nan]
    found = np.empty(len(x))
    interpolate(x, at, 30, 1 / (at[1] - at[0]), 1 / (at[-1] - at[-2]), values, found)
    assert np.allclose(found, np.interp(x, at, values), rtol=0, atol=1e-14, equal_nan=True)


def test_what_points_and_photos_have_in_common_is_taken_off():
    random = np.random.default_rng(0)
    point, photo = random.integers(0, 40, 400), random.integers(0, 9, 400)
    own = random.standard_normal(400)
    left = surface_bands.between(own + random.standard_normal(40)[point], point, photo)
    assert np.allclose(left, surface_bands.between(own, point, photo))
    assert np.abs(np.bincount(point, left)).max() < 1e-9
    shifted = surface_bands.between(own + 3.0 * (photo == 4), point, photo)
    assert np.abs(shifted - left).max() < 0.3


def test_bins_hold_equally_many_and_are_their_medians():
    random = np.random.default_rng(0)
    for count in (29, 30, 37, 400):
        x, y = random.standard_normal((2, count))
        parts = [part for part in np.array_split(np.argsort(x), LOCAL.bins) if len(part) >= 3]
        found_x, found_y, _ = _binned(x, y)
        assert np.array_equal(found_x, [np.median(x[part]) for part in parts])
        assert np.array_equal(found_y, [np.median(y[part]) for part in parts])
