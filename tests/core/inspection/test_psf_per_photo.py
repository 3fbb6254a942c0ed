"""Every photo's own width: kept where blurs differ, given up where they do not."""

import numpy as np
import pytest
from dgs.benchmarks.effect_scenes import Truth, own_sigmas
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.inspection.psf_per_photo import psf_per_photo


def test_equal_photos_share_their_blur(taken):
    found = psf_per_photo(taken(psf=(3.0, 3.0, 0.0)).photos, parse_psf("gaussian:3"), linear=True)
    assert found.spreads == {} and found.between == 0.0 and "all get the shared one" in found.text
    assert set(found.shrunk.values()) == {3.0} and len(set(found.alone.values())) > 1


def test_photos_that_differ_keep_their_own(taken):
    truth = own_sigmas(Truth(own=(1.5, 4.0)), 8, 1)
    photos = taken(own=(1.5, 4.0)).photos
    shared = parse_psf(f"gaussian:{np.sqrt(np.median(truth**2))}")
    found = psf_per_photo(photos, shared, linear=True)
    widths = np.array([found.shrunk[photo.name] for photo in photos])
    assert np.abs(widths - truth).max() < 0.5
    assert np.abs(widths - truth).mean() < 0.35 * np.abs(shared.sigma_x - truth).mean()
    assert all(psf.sigma_x == psf.sigma_y == pytest.approx(found.shrunk[n]) for n, psf in found.spreads.items())
    assert f"{widths.min():.2f} to {widths.max():.2f}" in found.text
    # Each lies between what it says itself and what all say.
    for name, sigma in found.shrunk.items():
        low, high = sorted((found.alone[name], shared.sigma_x))
        assert low - 1e-9 <= sigma <= high + 1e-9
    assert parse_psf(found.spreads[photos[0].name].source).sigma_x == pytest.approx(widths[0], abs=1e-3)


def test_few_photos_share_theirs(taken):
    found = psf_per_photo(taken(own=(1.5, 4.0)).photos[:4], parse_psf("gaussian:3"), linear=True)
    assert found.spreads == {} and "only 4 photos" in found.text
