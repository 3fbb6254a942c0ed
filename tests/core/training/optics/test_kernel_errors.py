"""How well a photo determines its kernel: intervals that hold the truth, and shrink as the noise does."""

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb
from dgs.core.imaging.formation.kernel_convolution import seen_through_tents
from dgs.core.imaging.formation.kernels import KERNELS
from dgs.core.training.optics.kernel_errors import errors_of, tile_of
from dgs.core.training.optics.kernel_weights import SETTINGS, best_weights, places_of_weights
from dgs.core.training.optics.kernels import SeenThroughTents
from scipy.ndimage import gaussian_filter

COUNT = 1 + KERNELS.side**2
HALF = (places_of_weights() ** 2).sum(axis=1) / 2.0


def blob(width: float) -> np.ndarray:
    """[K] a Gaussian, `width` distances of tents wide."""
    weights = np.exp(-HALF / width**2)
    weights[0] = 0.0
    return weights / weights.sum()


def twice(turn: int) -> np.ndarray:
    """[K] a point seen twice, along a row, a column or a diagonal of tents."""
    squares, middle = np.zeros((KERNELS.side, KERNELS.side)), KERNELS.side // 2
    down, across = ((0, 3), (3, 0), (2, 2), (2, -2))[turn % 4]
    for way in (-1, 1):
        squares[middle + way * down, middle + way * across] = 0.5
    return np.concatenate([[0.0], squares.ravel()])


def light(random: np.random.Generator, contrast: float = 0.15) -> torch.Tensor:
    """[3, 100, 100] linear, with the spectrum of photos."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(100), np.fft.fftfreq(100)))
    frequency[0, 0] = 1.0
    planes = np.fft.ifft2(np.fft.fft2(random.normal(size=(3, 100, 100))) / frequency).real
    return torch.from_numpy((planes / planes.std() * contrast + 0.4).clip(0.02, 1.0))


def determined(true: np.ndarray, noise: float, seed: int, contrast: float = 0.15, alike: float = 0.0):
    """Variance of the kernel that a made-up photo shows, and its standard error; alike: px that noise is soft by."""
    random = np.random.default_rng(seed)
    through = seen_through_tents(light(random, contrast), 10, KERNELS.side, 2.5, 1)
    photo = linear_to_srgb(torch.einsum("ckhw,k->chw", through, torch.from_numpy(true)))
    added = gaussian_filter(random.normal(size=photo.shape), (0, alike, alike))
    photo = photo + torch.from_numpy(noise * added / added.std())
    weights = np.zeros(COUNT)
    weights[0] = 1.0
    for _ in range(4):  # (the noise as it shows follows from the kernel)
        seen = SeenThroughTents.of(through, photo, torch.from_numpy(weights), None, SETTINGS)
        matrix, vector = seen.normal_equations()
        weights = best_weights(matrix, vector)
    return float(weights @ HALF), errors_of(matrix, vector, seen.slopes(weights), weights, SETTINGS), weights


def test_intervals_hold_the_truth():
    """At least 90 % of those of 95 %, for kernels of three forms in white noise."""
    inside, of_weights = [], []
    for seed in range(24):
        true = (twice(seed), blob(1.5), blob(2.5))[seed % 3]
        variance, errors, weights = determined(true, 0.01, seed)
        inside.append(abs(variance - true @ HALF) <= KERNELS.sure * errors.variance)
        bright = true > 0.02
        of_weights.append(np.mean(abs(weights - true)[bright] <= KERNELS.sure * errors.weights[bright] + 1e-3))
        assert errors.variance < 0.15 * true @ HALF, "and they say something"
    assert np.mean(inside) >= 0.9 and np.mean(of_weights) >= 0.85, (np.mean(inside), np.mean(of_weights))


def test_intervals_shrink_as_noise_does():
    errors = [[determined(twice(seed), noise, seed)[1].variance for noise in (0.002, 0.01, 0.05)] for seed in range(4)]
    low, middle, high = np.median(errors, axis=0)
    assert 3 * low < middle and 3 * middle < high


def test_neighbours_that_err_alike_say_less():
    """What is left of a photo behind a twin is smooth: the same noise, alike over 2 px, leaves kernels less sure."""
    for seed in range(3):
        white, smooth = (determined(blob(2.0), 0.01, seed, alike=alike)[1].variance for alike in (0.0, 2.0))
        assert smooth > 1.5 * white


def test_a_photo_without_detail_determines_nothing():
    """Nearly grey: without the price of width the kernel could be anything, and the error says so."""
    variance, errors, _ = determined(blob(2.0), 0.01, 0, contrast=1e-4)
    assert variance < 0.5 and errors.variance > 1.0


def test_tiles_are_alike_and_cover_the_photo():
    found = tile_of(13, 20)
    assert found.shape == (13, 20) and sorted(np.unique(found)) == list(range(36))
    assert np.bincount(found.ravel()).min() >= 2 * 3


def test_a_kernel_that_has_not_arrived_is_less_sure():
    true = blob(2.0)
    through = seen_through_tents(light(np.random.default_rng(0)), 10, KERNELS.side, 2.5, 1)
    photo = linear_to_srgb(torch.einsum("ckhw,k->chw", through, torch.from_numpy(true)))
    seen = SeenThroughTents.of(through, photo, torch.from_numpy(true), None, SETTINGS)
    matrix, vector = seen.normal_equations()
    slopes = seen.slopes(true)
    there, on_the_way = (errors_of(matrix, vector, slopes, now, SETTINGS) for now in (true, blob(1.5)))
    assert on_the_way.variance == pytest.approx(true @ HALF - blob(1.5) @ HALF, rel=0.1)
    assert there.variance < 0.1 * on_the_way.variance
