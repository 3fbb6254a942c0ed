"""What a blurred photo says of the picture without motion."""

import numpy as np
import pytest
import torch
from dgs.core.training.restored.inverse import InverseSettings, fading_parts, inverted, transfer_of

HEIGHT, WIDTH = 90, 130


def way_along(right, down, bend=0.0):
    """[K, 2] of a way of so many px, bent to one side."""
    along = torch.linspace(-0.5, 0.5, 33)
    aside = bend * (along.square() - 1 / 12)
    return torch.stack([right * along - down * aside, down * along + right * aside], dim=1)


def drawn(seed=0):
    """[3, H, W] light in the middle of the dark, as rough as photos are."""
    noise = np.random.default_rng(seed).standard_normal((3, HEIGHT, WIDTH))
    far = np.hypot(np.fft.fftfreq(HEIGHT)[:, None], np.fft.rfftfreq(WIDTH)[None])
    rough = np.fft.irfft2(np.fft.rfft2(noise) / (0.03 + far), s=(HEIGHT, WIDTH))
    window = np.zeros((HEIGHT, WIDTH))
    window[25:-25, 25:-25] = 1
    return torch.from_numpy(rough / rough.std() * window).float()


def blurred(light, places):
    transfer = transfer_of(places, HEIGHT, WIDTH)
    return torch.fft.irfft2(torch.fft.rfft2(light) * transfer, s=(HEIGHT, WIDTH))


def left(found, true):
    """Of the true light's power."""
    return float((found - true).square().sum() / true.square().sum())


def test_parts_add_up_to_the_whole():
    for count in (1, 2, 3, 4):
        parts = list(fading_parts(HEIGHT, WIDTH, count))
        assert len(parts) == count**2
        assert torch.allclose(sum(parts), torch.ones(HEIGHT, WIDTH), atol=1e-6)


def test_a_way_has_the_transfer_of_its_places():
    places = torch.tensor([[2.0, -1.0], [-3.0, 0.0]])
    light = torch.zeros(1, HEIGHT, WIDTH)
    light[0, 40, 60] = 1.0
    moved = blurred(light, places)[0]
    assert float(moved[39, 62]) == pytest.approx(0.5, abs=1e-5) and float(moved[40, 57]) == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("way", [way_along(9.0, 4.0), way_along(-3.0, 12.0, bend=1.5), way_along(0.0, 0.0) + 3.0])
def test_what_motion_blurred_comes_back(way):
    light = drawn()
    photo = blurred(light, way)
    assert left(inverted(photo, lambda _: way), light) < 0.7 * left(photo, light)
    assert left(inverted(photo, lambda _: way, InverseSettings(noise=1e-4)), light) < 0.1


def test_the_less_noise_is_expected_the_more_comes_back():
    light, way = drawn(), way_along(9.0, 4.0)
    photo = blurred(light, way)
    errors = [left(inverted(photo, lambda _: way, InverseSettings(noise=noise)), light) for noise in (1.0, 0.1, 0.01)]
    assert errors == sorted(errors, reverse=True)


def test_each_part_has_a_way_of_its_own():
    """The left half moved down, the right half to the right: neither way alone explains the photo."""
    light, ways = drawn(), (way_along(0.0, 10.0), way_along(10.0, 0.0))
    right = torch.linspace(0, 1, WIDTH)
    photo = blurred(light * (1 - right), ways[0]) + blurred(light * right, ways[1])

    def own(weights):
        return ways[0] if float((weights.sum(dim=0) * right).sum() / weights.sum()) < 0.5 else ways[1]

    settings = InverseSettings(parts=2)
    alone = [left(inverted(photo, lambda _, way=way: way, settings), light) for way in ways]
    assert left(inverted(photo, own, settings), light) < 0.85 * min(alone)
