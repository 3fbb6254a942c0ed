"""Metrics against values worked out by hand."""

import numpy as np
import pytest
from dgs.core.evaluation.metrics import Band, bands, edge_sharpness, low_passed, low_passed_truth_psnr, psnr, ssim
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity


def band(image, truth) -> Band:
    """Periods from 10 to 7 px."""
    return bands(image, truth, [(10, 7)])[0]


def noise(height=64, width=96, seed=0):
    return np.random.default_rng(seed).uniform(0.2, 0.8, (height, width, 3))


def test_psnr_of_a_known_error():
    truth = noise()
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0)
    assert psnr(truth, truth) == 100.0


def test_border_and_mask_leave_pixels_out():
    truth = noise()
    image = truth.copy()
    image[:4] += 0.3
    assert psnr(image, truth) == pytest.approx(-10 * np.log10(0.3**2 * 4 / len(truth)))
    assert psnr(image, truth, border=4) == 100.0
    mask = np.ones(truth.shape[:2], bool)
    mask[:4] = False
    assert psnr(image, truth, mask) == 100.0
    assert np.isnan(psnr(image, truth, np.zeros_like(mask)))
    assert ssim(image, truth, border=12) == pytest.approx(1.0)
    assert ssim(image, truth) < 0.985


def test_ssim_of_flat_images_is_the_luminance_term():
    a, b = np.full((32, 32, 3), 0.4), np.full((32, 32, 3), 0.6)
    expected = (2 * 0.4 * 0.6 + 1e-4) / (0.4**2 + 0.6**2 + 1e-4)
    assert ssim(a, b) == pytest.approx(expected, rel=1e-6)
    assert ssim(a, a + 1e-7) <= 1.0


@pytest.mark.parametrize("size", [(64, 96), (11, 40), (40, 11)])
def test_ssim_is_that_of_scikit_image(size):
    truth = noise(*size)
    image = np.clip(truth + 0.2 * (noise(*size, seed=1) - 0.5), 0, 1)
    keep = noise(*size, seed=2)[..., 0] > 0.4
    words = {"data_range": 1.0, "channel_axis": 2, "gaussian_weights": True, "sigma": 1.5, "full": True}
    _, full = structural_similarity(image, truth, use_sample_covariance=False, **words)
    assert ssim(image, truth) == pytest.approx(full.mean(), abs=1e-13)
    assert ssim(image, truth, keep) == pytest.approx(full[keep].mean(), abs=1e-13)
    # (planes first in memory, as renders come)
    turned = np.ascontiguousarray(image.transpose(2, 0, 1)).transpose(1, 2, 0)
    assert ssim(turned, truth, keep) == ssim(image, truth, keep)


def test_ssim_of_a_tiny_image_is_unknown():
    assert np.isnan(ssim(noise(8, 8), noise(8, 8)))


def wave(period, amplitude=0.25, size=(120, 160)):
    row = 0.5 + amplitude * np.cos(2 * np.pi * (np.arange(size[1]) + 0.5) / period)
    return np.broadcast_to(row[None, :, None], (*size, 3)).copy()


def test_low_pass_cuts_at_the_frequency():
    truth = wave(8)
    np.testing.assert_allclose(low_passed(truth, 1 / 7), truth, atol=1e-9)
    np.testing.assert_allclose(low_passed(truth, 1 / 9), 0.5, atol=1e-9)
    # All of a cosine's power is lost: amplitude^2 / 2.
    assert low_passed_truth_psnr(truth, 1 / 9) == pytest.approx(-10 * np.log10(0.25**2 / 2))


def test_band_separates_missing_from_invented():
    truth = wave(8) + wave(32) - 0.5
    half = band(0.5 * wave(8) + wave(32), truth)
    assert (half.gain, half.correlation, half.energy) == pytest.approx((0.5, 1.0, 0.5))
    other = band(wave(40), truth)
    assert (other.gain, other.correlation) == pytest.approx((0, 0), abs=1e-9)
    invented = truth + 0.1 * (noise(120, 160) - 0.5)
    speckled = band(invented, truth)
    assert speckled.energy > speckled.gain and speckled.correlation < 1
    assert np.isnan(band(truth, np.full_like(truth, 0.5)).gain)


def test_edge_sharpness_falls_with_blur_and_ignores_distant_speckle():
    truth = np.zeros((64, 64, 3))
    truth[:, 32:] = 1
    assert edge_sharpness(truth, truth) == pytest.approx(1.0)
    # The slope of an edge under a Gaussian is 1 / (sigma sqrt(2 pi)); np.gradient reads 1/2 of a step.
    blurred = gaussian_filter(truth, (0, 3, 0))
    assert edge_sharpness(blurred, truth) == pytest.approx(1 / (3 * np.sqrt(2 * np.pi)) / 0.5, rel=0.05)
    speckled = blurred.copy()
    speckled[::2, :16] += 0.5
    assert edge_sharpness(speckled, truth) == pytest.approx(edge_sharpness(blurred, truth))


def test_sizes_must_agree():
    with pytest.raises(ValueError, match="size"):
        psnr(noise(8, 8), noise(8, 9))
