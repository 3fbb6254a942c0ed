"""A view in layers, blurred by distance: what kernels find is what torch finds, and what a sampled lens sees."""

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.imaging.formation.layer_blur import blurred_layers, blurred_layers_in_torch, places
from dgs.core.imaging.formation.occluding import ladder_of
from torch import Tensor

HEIGHT, WIDTH = 60, 84
SIZE = (HEIGHT, WIDTH)


def random_layers(numbers: tuple[int, ...], seed: int = 0) -> tuple[Tensor, Tensor]:
    """Planes [L, 4, h, w] whose farthest one covers everything, and the view of them."""
    random = torch.Generator().manual_seed(seed)
    share = torch.rand(len(numbers), 1, *SIZE, generator=random)
    share = torch.where(share < 0.5, 0.0, share)
    share[0] = 1.0
    planes = torch.cat([share * torch.rand(len(numbers), 3, *SIZE, generator=random), share], dim=1)
    image = torch.zeros(3, *SIZE)
    for plane in planes:
        image = plane[:3] + (1 - plane[3]) * image
    return planes, image


def test_places_lie_between_the_rungs_by_their_variance() -> None:
    ladder = ladder_of("disk", SIZE)
    signed = torch.tensor([ladder[0] - 5.0, ladder[0], 0.25 * ladder[1] + 0.75 * ladder[2], 0.0, ladder[-1], 1e6])
    found = places(signed.sign() * signed.abs().sqrt(), "disk", SIZE)
    middle, last = len(ladder) // 2, len(ladder) - 1
    torch.testing.assert_close(found, torch.tensor([0.0, 0.0, 1.75, middle, last, last]))


def test_without_blur_the_light_is_that_of_the_view() -> None:
    middle = len(ladder_of("disk", SIZE)) // 2
    planes, image = random_layers((middle,))
    torch.testing.assert_close(blurred_layers(planes, (middle,), image, "disk"), srgb_to_linear(image))


@pytest.mark.parametrize("numbers", [(0, 1, 2, 3, 5), (2, 3, 4), (1, 4)])
def test_kernels_find_what_torch_finds_and_its_gradient(numbers: tuple[int, ...]) -> None:
    planes, image = random_layers(numbers)
    weight = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(9))
    found = []
    for blurred, dtype in ((blurred_layers, torch.float32), (blurred_layers_in_torch, torch.float64)):
        leaves = planes.to(dtype, copy=True).requires_grad_(), image.to(dtype, copy=True).requires_grad_()
        light = blurred(leaves[0], numbers, leaves[1], "disk")
        (light * weight.to(dtype)).sum().backward()
        found.append((light.detach().double(), *(leaf.grad.double() for leaf in leaves if leaf.grad is not None)))
    shows = planes[:, 3] > 0  # (a layer's gradient where it shows nothing is that of a colour that nothing has)
    for own, expected in zip(*found, strict=True):
        if own.dim() == 4:
            own, expected = own[:, 3:][shows[:, None]], expected[:, 3:][shows[:, None]]
        scale = float(expected.abs().max())
        torch.testing.assert_close(own, expected, atol=2e-4 * scale, rtol=2e-4)
    own, expected = (pair[1][:, :3] for pair in found)
    everywhere = shows[:, None].expand(own.shape)
    torch.testing.assert_close(
        own[everywhere], expected[everywhere], atol=2e-4 * float(expected.abs().max()), rtol=2e-4
    )


def seen_by_lens(back: np.ndarray, front: np.ndarray, share: np.ndarray, radius: float) -> np.ndarray:
    """Linear light behind a lens focused on what lies behind: the front is seen shifted by each point of the hole."""
    total, count = np.zeros_like(back), 0
    steps = np.linspace(-1, 1, 41) * radius
    for dy in steps:
        for dx in steps:
            if dx * dx + dy * dy > radius * radius:
                continue
            moved = [np.roll(one, (round(dy), round(dx)), axis=(-2, -1)) for one in (share, front)]
            total += moved[0] * moved[1] + (1 - moved[0]) * back
            count += 1
    return total / count


def test_a_thin_twig_out_of_focus_lets_the_wall_behind_it_through() -> None:
    random = np.random.default_rng(0)
    back = np.kron(random.uniform(0.2, 0.8, (3, 10, 14)), np.ones((1, 6, 6)))
    share = np.zeros(SIZE)
    share[:, 40:43] = 1.0
    front = np.broadcast_to(np.array([0.05, 0.3, 0.02])[:, None, None], back.shape)
    ladder = ladder_of("disk", SIZE)
    middle = len(ladder) // 2
    rung = len(ladder) - 1 - middle
    expected = seen_by_lens(back, front, share, 2 * ladder[-1] ** 0.5)
    srgb = lambda light: linear_to_srgb(torch.from_numpy(light).float())  # noqa: E731
    covering = torch.from_numpy(share).float()[None]
    far, near = torch.cat([srgb(back), torch.ones(1, *SIZE)]), torch.cat([covering * srgb(front.copy()), covering])
    image = near[:3] + (1 - near[3]) * far[:3]
    found = blurred_layers(torch.stack([far, near]), (middle, middle + rung), image, "disk").numpy()
    inside = (slice(None), slice(12, -12), slice(20, -20))
    assert np.abs(found - expected)[inside].max() < 0.03
    # One picture, blurred by the depth of its surface, keeps the twig whole where it stands.
    assert np.abs(image.numpy() - expected)[inside].max() > 0.2
