"""Wiener deconvolution and the Newton-type filter."""

import numpy as np
import pytest
import torch
from dgs.core.imaging.fourier import FourierFilter, wiener_photo
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf_text import parse_psf


def scene(height: int, width: int) -> torch.Tensor:
    noise = torch.rand(3, height + 16, width + 16, generator=torch.Generator().manual_seed(3))
    return BlurOperator(parse_psf("gaussian:2"), height, width, 8).apply(noise)


def test_wiener_brings_detail_back_but_at_the_border():
    psf = parse_psf("gaussian:2.5")
    sharp = scene(140, 180)
    photo, truth = BlurOperator(psf, 120, 160, 10).apply(sharp), sharp[:, 10:-10, 10:-10]
    restored = wiener_photo(photo, psf, 1e-4)
    middle = (slice(None), slice(16, -16), slice(16, -16))  # 1.6 times as far from the border as the PSF reaches

    def error(image: torch.Tensor) -> float:
        return float((image - truth)[middle].square().sum().sqrt())

    assert error(restored) < 0.5 * error(photo)


def test_no_psf_returns_the_photo():
    photo = scene(30, 40)
    assert wiener_photo(photo, None, 1e-5) is photo


@pytest.mark.parametrize("kind", ["newton", "wiener"])
@pytest.mark.parametrize("name", ["gaussian:3", "gaussian:3,1,20"])
def test_adjoint(kind, name):
    psf = parse_psf(name)
    assert psf is not None
    filter_ = FourierFilter(psf, (40, 51), 1e-3, kind, dtype=torch.float64)
    x, y = torch.rand(2, 3, 40, 51, dtype=torch.float64)
    assert (filter_.apply(x) * y).sum() == pytest.approx(float((x * filter_.adjoint(y)).sum()), rel=1e-12)


def test_newton_is_wiener_of_the_blurred():
    psf = parse_psf("gaussian:2")
    assert psf is not None
    x = torch.zeros(1, 90, 90, dtype=torch.float64)
    x[0, 40:50, 40:52] = 1.0
    blurred = BlurOperator(psf, 90, 90, dtype=torch.float64).apply(x)
    newton = FourierFilter(psf, (90, 90), 1e-2, "newton", dtype=torch.float64).apply(x)
    wiener = FourierFilter(psf, (90, 90), 1e-2, "wiener", dtype=torch.float64).apply(blurred)
    assert (newton - wiener).abs().max() < 1e-4 and newton.max() > 0.9


def test_noise_over_frequency():
    psf = parse_psf("gaussian:2")
    assert psf is not None
    x = torch.rand(1, 30, 30)
    constant = FourierFilter(psf, (30, 30), 1e-3).apply(x)
    listed = FourierFilter(psf, (30, 30), np.full(20, 1e-3)).apply(x)
    assert (constant - listed).abs().max() < 1e-6
    with pytest.raises(ValueError, match="positive"):
        FourierFilter(psf, (30, 30), 0.0)
