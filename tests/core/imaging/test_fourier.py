"""Wiener deconvolution and the Newton-type filter."""

import numpy as np
import pytest
import torch
from dgs.core.imaging.fourier import FourierFilter, border_weight, wiener_photo
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf_text import parse_psf


def scene(height: int, width: int) -> torch.Tensor:
    noise = torch.rand(3, height + 16, width + 16, generator=torch.Generator().manual_seed(3))
    return BlurOperator(parse_psf("gaussian:2"), height, width, 8).apply(noise)


def test_wiener_brings_detail_back_where_the_weight_says_so():
    psf = parse_psf("gaussian:2.5")
    sharp = scene(140, 180)
    photo, truth = BlurOperator(psf, 120, 160, 10).apply(sharp), sharp[:, 10:-10, 10:-10]
    restored = wiener_photo(photo, psf, 1e-4)
    weight = restored.weight

    def error(image: torch.Tensor) -> float:
        return float(((image - truth) ** 2 * weight).sum().sqrt())

    assert error(restored.planes) < 0.5 * error(photo)
    assert weight[60, 80] == 1 and weight[0, 80] == 0 and weight[60, -1] == 0


def test_no_psf_returns_the_photo():
    photo = scene(30, 40)
    assert wiener_photo(photo, None, 1e-5).planes is photo
    assert border_weight(None, 5, 6).min() == 1


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
