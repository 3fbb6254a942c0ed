"""The inverse for every width: even widths are Wiener's, widths between rungs lie between them."""

import numpy as np
import pytest
import torch
from dgs.core.imaging.formation.layered import LADDER
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.spectrum import BINS, NoiseToSignal
from dgs.core.training.loss.objective import Inverse
from dgs.core.training.loss.through_glass import InverseByWidth

H, W = 60, 76
CPU = torch.device("cpu")
RATIO = NoiseToSignal(np.geomspace(1e-6, 1e-2, BINS), np.geomspace(1e-5, 1e-1, BINS), 0.002)


def residual() -> torch.Tensor:
    """Nothing near the border, where grids of other sizes close elsewhere."""
    planes = torch.zeros(3, H, W)
    planes[:, 20:40, 25:50] = 0.1 * torch.from_numpy(np.random.default_rng(0).normal(size=(3, 20, 25))).float()
    return planes


@pytest.mark.parametrize("rung", [1, 2, 3])
def test_an_even_width_is_wiener_s_inverse(rung):
    sigma = LADDER[rung]
    wanted = Inverse(PointSpread(sigma_x=sigma, sigma_y=sigma), H, W, RATIO, CPU).apply(residual())
    found = InverseByWidth(H, W, RATIO, LADDER[3], CPU).apply(residual(), torch.full((H, W), sigma))
    inner = (..., slice(15, -15), slice(15, -15))
    assert float((found - wanted)[inner].abs().max()) < 0.02 * float(wanted.abs().max())


def test_each_px_takes_its_own_width():
    inverse = InverseByWidth(H, W, RATIO, LADDER[3], CPU)
    sigma = torch.full((H, W), LADDER[1])
    sigma[:, W // 2 :] = LADDER[3]
    mixed = inverse.apply(residual(), sigma)
    halves = [inverse.apply(residual(), torch.full((H, W), LADDER[k])) for k in (1, 3)]
    assert torch.allclose(mixed[..., : W // 2], halves[0][..., : W // 2], atol=1e-5)
    assert torch.allclose(mixed[..., W // 2 :], halves[1][..., W // 2 :], atol=1e-5)
    assert torch.equal(inverse.apply(residual(), torch.zeros(H, W)), residual())
    between = inverse.apply(residual(), torch.full((H, W), float(np.sqrt((LADDER[1] ** 2 + LADDER[2] ** 2) / 2))))
    ends = [inverse.apply(residual(), torch.full((H, W), LADDER[k])) for k in (1, 2)]
    assert torch.allclose(between, (ends[0] + ends[1]) / 2, atol=1e-5)
