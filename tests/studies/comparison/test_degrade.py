"""Media of other families: their widths, their light, and what they do to a picture."""

import numpy as np
import pytest
from dgs.core.imaging.kernel_samples import disc
from dgs.studies.comparison import degrade
from scipy.ndimage import gaussian_filter


def variance(kernel):
    axis = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    return float((kernel.sum(0) * axis**2).sum())


def half_width(kernel):
    """Full width at half maximum of the middle row, px."""
    row = kernel[kernel.shape[0] // 2]
    fine = np.linspace(0, len(row) - 1, 40 * len(row))
    values = np.interp(fine, np.arange(len(row)), row)
    return float(np.ptp(fine[values >= row.max() / 2]))


@pytest.mark.parametrize("kernel", [degrade.gaussian(3), degrade.moffat(3), disc(5), degrade.two_gaussians(3)], ids=str)
def test_kernels_are_centred_and_keep_light(kernel):
    assert kernel.sum() == pytest.approx(1.0) and kernel.min() >= 0
    assert kernel.shape[0] % 2 == kernel.shape[1] % 2 == 1
    assert np.allclose(kernel, kernel[::-1, ::-1])


def test_widths_are_as_said():
    assert variance(degrade.gaussian(3)) == pytest.approx(9.0, rel=1e-3)
    assert half_width(degrade.moffat(4)) == pytest.approx(half_width(degrade.gaussian(4)), rel=0.02)
    assert variance(degrade.moffat(4)) > 1.3 * 16
    assert variance(disc(6)) == pytest.approx(9.0, rel=0.02)  # R^2 / 4
    assert variance(degrade.two_gaussians(3)) == pytest.approx(9 * (0.85 + 0.15 * 2.5**2), rel=0.05)


def test_a_photograph_is_the_convolution():
    sharp = np.random.default_rng(0).integers(0, 255, (60, 70, 3)).astype(np.uint8)
    photo = degrade.photographed(sharp, degrade.gaussian(2.0))
    expected = gaussian_filter(sharp / 255.0, (2, 2, 0), truncate=5) * 255
    assert np.abs(photo - expected)[10:-10, 10:-10].max() <= 0.51
    noisy = degrade.photographed(sharp, degrade.gaussian(2.0), noise=0.03, seed=(1, 2)).astype(float)
    assert (noisy - photo)[10:-10, 10:-10].std() == pytest.approx(0.03 * 255, rel=0.05)
    assert np.array_equal(noisy, degrade.photographed(sharp, degrade.gaussian(2.0), noise=0.03, seed=(1, 2)))
    pressed = degrade.photographed(sharp, degrade.gaussian(2.0), jpeg=90)
    assert 0 < np.abs(pressed.astype(float) - photo).mean() < 3
