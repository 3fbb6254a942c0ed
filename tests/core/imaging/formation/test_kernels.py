"""Free kernels: what their weights mean on any grid, the convolution, and both gradients."""

import math

import pytest
import torch
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.kernel_convolution import convolved, kernel_of, seen_through_tents
from dgs.core.imaging.formation.kernels import KERNELS, PhotoKernels

MARGIN = 8
#: Px of the grid between tents: coarse grids, where a tent is narrower than a px, and fine ones.
PITCHES = (0.6, 1.0, 2.5, 3.9)


def weights(seed: int = 0) -> torch.Tensor:
    found = torch.rand(1 + KERNELS.side**2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return found / found.sum()


def light(height: int = 20, width: int = 27) -> torch.Tensor:
    size = (3, height + 2 * MARGIN, width + 2 * MARGIN)
    return torch.rand(size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


@pytest.mark.parametrize("pitch", PITCHES)
def test_no_light_is_lost_and_the_middle_stays(pitch: float) -> None:
    kernel = kernel_of(weights(), KERNELS.side, pitch)
    assert float(kernel.sum()) == pytest.approx(1.0)
    upright = weights()
    upright[1:] += upright[1:].flip(0)
    kernel = kernel_of(upright, KERNELS.side, pitch)
    assert torch.allclose(kernel, kernel.flip(0, 1))
    alone = torch.zeros(1 + KERNELS.side**2, dtype=torch.float64)
    alone[1 + KERNELS.side] = 1.0  # second row, first tent: left of the middle, and above it
    kernel = kernel_of(alone, KERNELS.side, pitch)
    px = torch.arange(len(kernel), dtype=torch.float64) - len(kernel) // 2
    assert float(kernel.sum(dim=0) @ px) == pytest.approx(-4 * pitch, abs=0.51)
    assert float(kernel.sum(dim=1) @ px) == pytest.approx(-3 * pitch, abs=0.51)


def test_a_point_is_seen_as_its_kernel() -> None:
    kernel = kernel_of(weights(), KERNELS.side, 1.0)
    point = torch.zeros(3, 31, 33, dtype=torch.float64)
    point[:, 15, 16] = 1.0
    radius = len(kernel) // 2
    seen = convolved(point, kernel)[:, 15 - radius : 16 + radius, 16 - radius : 17 + radius]
    assert torch.allclose(seen, kernel.expand(3, -1, -1))


@pytest.mark.parametrize("pitch", PITCHES)
@pytest.mark.parametrize("every", [1, 3])
def test_light_through_all_tents_adds_up_to_the_photo(pitch: float, every: int) -> None:
    given, image = weights(), light()
    rows = slice(MARGIN + every // 2, MARGIN + 20, every), slice(MARGIN + every // 2, MARGIN + 27, every)
    wanted = convolved(image, kernel_of(given, KERNELS.side, pitch))[:, *rows]
    seen = seen_through_tents(image, MARGIN, KERNELS.side, pitch, every)
    assert torch.allclose(torch.einsum("ckhw,k->chw", seen, given), wanted)


def test_gradients_are_those_of_finite_differences() -> None:
    shot = Shot("a", 6, 7, 2)
    given = weights()[None].requires_grad_()
    image = light(6, 7)[:, MARGIN - 2 : MARGIN + 8, MARGIN - 2 : MARGIN + 9].contiguous().requires_grad_()
    assert torch.autograd.gradcheck(lambda w, x: PhotoKernels(["a"], w).forward(x, shot), (given, image))


def test_photos_that_are_not_named_pass_unchanged() -> None:
    effect, image = PhotoKernels.sharp(["a"]), light()
    assert effect.forward(image, Shot("b", 20, 27, MARGIN)) is image
    assert torch.allclose(effect.forward(image, Shot("a", 20, 27, MARGIN)), image)
    assert effect.widths() == {"a": 0.0}


def test_a_kernel_is_the_same_on_every_grid() -> None:
    effect = PhotoKernels(["a"], weights()[None].float())
    diagonal = 1200.0
    spreads = []
    for step in (1, 2, 4):
        kernel = effect.kernel(0, diagonal / step, torch.zeros(1, dtype=torch.float64))
        px = (torch.arange(len(kernel), dtype=torch.float64) - len(kernel) // 2) * step
        middle = float(kernel.sum(dim=0) @ px)
        spreads.append(math.sqrt(float(kernel.sum(dim=0) @ (px - middle) ** 2)))
    assert spreads[0] == pytest.approx(spreads[1], rel=0.03) == pytest.approx(spreads[2], rel=0.1)
