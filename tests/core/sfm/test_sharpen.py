"""The blur undone: gain by frequency, borders, and grey values."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.sfm.sharpen import _tapered, as_bytes, luma, wiener


def gaussian(sigma: float, radius: int) -> np.ndarray:
    x = np.arange(-radius, radius + 1)
    line = np.exp(-(x**2) / (2 * sigma**2))
    return np.outer(line, line) / line.sum() ** 2


@pytest.mark.parametrize(("kind", "full"), [(np.uint8, 255), (np.uint16, 65535)])
def test_luma_of_pure_colours(kind: type, full: int) -> None:
    pixels = np.array([[[full, 0, 0], [0, full, 0], [0, 0, full], [full, full, full]]], kind)
    grey = luma(pixels)
    assert grey.dtype == np.float32
    np.testing.assert_allclose(grey, [[0.2126, 0.7152, 0.0722, 1.0]], rtol=1e-6)


def test_bytes_are_rounded_and_clipped() -> None:
    values = np.array([[-0.2, 0.0, 0.49 / 255, 0.51 / 255, 254.4 / 255, 254.6 / 255, 1.0, 2.0]], np.float32)
    assert as_bytes(values).tolist() == [[0, 0, 0, 1, 254, 255, 255, 255]] and as_bytes(values).dtype == np.uint8


@pytest.mark.parametrize("period", [16, 32])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_wave_gets_the_gain_of_its_frequency(period: int, axis: int) -> None:
    """H (1 + n) / (H^2 + n) for a Gaussian, whose transfer is real; far from the border."""
    size, noise = 256, 0.05
    at = np.arange(size)
    wave = 0.5 + 0.25 * np.cos(2 * np.pi * (at + 0.3) / period)
    image = np.broadcast_to(wave if axis else wave[:, None], (size, size)).astype(np.float32)
    kernel = gaussian(2.0, 9)
    x = np.arange(-9, 10)
    transfer = float((kernel.sum(axis=0) * np.cos(2 * np.pi * x / period)).sum())
    gain = transfer * (1 + noise) / (transfer**2 + noise)
    middle = slice(96, 160)
    np.testing.assert_allclose(
        wiener(image, kernel, noise)[middle, middle], 0.5 + gain * (image[middle, middle] - 0.5), atol=2e-3
    )


def test_a_kernel_off_its_centre_moves_the_photo_back() -> None:
    kernel = np.zeros((5, 7))
    kernel[1, 5] = 1.0  # one up, two to the right
    noise = np.random.default_rng(0).uniform(0.2, 0.8, (60, 80)).astype(np.float32)
    back = wiener(np.roll(noise, (-1, 2), (0, 1)), kernel, 1e-9)
    np.testing.assert_allclose(back[20:40, 25:55], noise[20:40, 25:55], atol=1e-3)


@pytest.mark.parametrize("shape", [(33, 47), (5, 47), (33, 5), (5, 5)])
def test_a_photo_of_one_value_stays_as_it_is(shape: tuple[int, int]) -> None:
    """Also one that is narrower than the kernel."""
    flat = np.full(shape, 0.3, np.float32)
    answer = wiener(flat, gaussian(3.0, 7))
    assert answer.shape == flat.shape and answer.dtype == np.float32
    np.testing.assert_allclose(answer, flat, atol=1e-6)


@pytest.mark.parametrize("shape", [(4, 5), (5, 4), (5,), (3, 3, 3)])
def test_kernels_are_odd_and_flat(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="odd"):
        wiener(np.zeros((9, 9), np.float32), np.ones(shape))


def test_borders_fade_into_their_opposite_side() -> None:
    image = np.ones((6, 8), np.float32)
    padded = _tapered(image, (2, 3), (4, 1))
    rows = [0.5 - 0.5 * np.cos(np.pi * (k + 0.5) / 2) for k in range(2)]
    after = [0.5 + 0.5 * np.cos(np.pi * (k + 0.5) / 3) for k in range(3)]
    columns = [0.5 - 0.5 * np.cos(np.pi * (k + 0.5) / 4) for k in range(4)]
    wanted = np.outer([*rows, *[1.0] * 6, *after], [*columns, *[1.0] * 8, 0.5])
    np.testing.assert_allclose(padded, wanted, atol=1e-6)


def test_borders_are_mirrored() -> None:
    image = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    padded = _tapered(image, (2, 2), (2, 2))
    assert padded.shape == (7, 8)
    assert padded[3, 1] == pytest.approx(image[1, 0] * (0.5 - 0.5 * np.cos(np.pi * 1.5 / 2)), abs=1e-6)
    assert padded[3, 6] == pytest.approx(image[1, 3] * (0.5 + 0.5 * np.cos(np.pi * 0.5 / 2)), abs=1e-6)
