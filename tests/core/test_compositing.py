"""Photos over one colour, and over another instead."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.background import WHITE, Background
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.compositing import blended, over_another, unblended, under
from scipy.ndimage import gaussian_filter

Array = np.ndarray


def scene(colour: tuple[float, float, float]) -> tuple[Array, Array]:
    """Some textured disc [3, H, W] over a colour, and its alpha [H, W], sharp to the px."""
    y, x = np.mgrid[:64, :64].astype(np.float32)
    alpha = ((x - 30) ** 2 + (y - 33) ** 2 < 18**2).astype(np.float32)
    colours = np.stack([0.5 + 0.4 * np.sin(x / 5), 0.4 + 0.3 * np.cos(y / 4), np.full_like(x, 0.2)])
    return alpha * colours + (1 - alpha) * np.asarray(colour, np.float32)[:, None, None], alpha


def blurred(planes: Array, space: str) -> Array:
    light = srgb_to_linear(planes) if space == "linear" else planes
    light = np.stack([gaussian_filter(plane, 3.0, mode="nearest") for plane in light]).astype(np.float32)
    return linear_to_srgb(light) if space == "linear" else light


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_a_blurred_photo_over_a_backdrop_is_the_blur_of_the_sharp_one_over_it(space: str) -> None:
    """Before any colour, in the space the blur is linear in; in the other one it is not."""
    other = (0.1, 0.9, 0.3)
    background, wrong = Background(WHITE, space), Background(WHITE, "srgb" if space == "linear" else "linear")
    over_white, alpha = scene(WHITE)
    empty = 1 - gaussian_filter(alpha, 3.0, mode="nearest")
    truth = blurred(scene(other)[0], space)
    found = over_another(background, blurred(over_white, space), empty, other)
    assert np.abs(found - truth).max() < 2e-5
    assert np.abs(over_another(wrong, blurred(over_white, space), empty, other) - truth).max() > 0.02


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_straight_colours_come_back(space: str) -> None:
    random = np.random.default_rng(0)
    colours = random.uniform(0, 1, (3, 20, 30)).astype(np.float32)
    empty = random.uniform(0, 0.95, (20, 30)).astype(np.float32)
    empty[:4] = 1.0
    background = Background((0.2, 0.5, 1.0), space)
    planes = blended(background, colours, empty)
    assert np.abs(unblended(background, planes, empty)[:, 4:] - colours[:, 4:]).max() < 1e-3
    assert np.abs(planes[:, :4] - np.array([0.2, 0.5, 1.0])[:, None, None]).max() < 1e-6


def test_opaque_px_stay_as_filed() -> None:
    straight = np.random.default_rng(0).integers(0, 65536, (10, 12, 3)).astype(np.uint16)
    full = np.full((10, 12), 65535, np.uint16)
    np.testing.assert_array_equal(under(Background(WHITE, "linear"), straight, full), straight)


def test_names() -> None:
    names = [Background(colour).name for colour in (WHITE, (0.0, 0.0, 0.0), (1.0, 0.5, 0.0))]
    assert names == ["white", "black", "#ff8000"]
