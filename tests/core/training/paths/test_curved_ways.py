"""Curved ways that explain a shaken photo, and whether another path does so better."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb
from dgs.core.training.paths.curved_ways import Alike, ExplainedPhoto, ShakenPhoto, curved_way
from dgs.core.training.paths.rivals import left_of, nearer
from scipy.ndimage import gaussian_filter

SIZE, ORDER = (150, 180), 4
LIKELY = np.r_[np.inf, [4.0 / m**2 for m in range(1, ORDER + 1)]]


def texture(seed: int) -> np.ndarray:
    """[3, H, W] light."""
    drawn = np.random.default_rng(seed).standard_normal((3, *SIZE))
    smooth = np.stack([gaussian_filter(plane, 1.0, mode="wrap") for plane in drawn])
    return np.asarray(0.5 + 0.12 * smooth / smooth.std())


def moved_along(light: np.ndarray, way: np.ndarray) -> np.ndarray:
    """The mean of `light` over a way [2, M + 1]."""
    places = np.polynomial.legendre.legvander(np.linspace(-1, 1, 101), way.shape[1] - 1) @ way.T
    down, right = np.fft.fftfreq(SIZE[0])[:, None], np.fft.rfftfreq(SIZE[1])
    transfer = np.mean([np.exp(-2j * np.pi * (right * x + down * y)) for x, y in places], axis=0)
    return np.asarray(np.fft.irfft2(np.fft.rfft2(light) * transfer, s=SIZE))


def filed(light: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(linear_to_srgb(light.clip(0.0, 1.0))).float()


def way_of(*coefficients: tuple[float, float]) -> np.ndarray:
    """[2, 5] from (x, y) of each degree from 1 on."""
    way = np.zeros((2, ORDER + 1))
    way[:, 1 : len(coefficients) + 1] = np.array(coefficients).T
    return way


CURVED = way_of((6.0, 1.0), (-1.0, 2.5), (0.4, -0.6))


def apart(first: np.ndarray, second: np.ndarray) -> float:
    places = [np.polynomial.legendre.legvander(np.linspace(-1, 1, 33), ORDER) @ way.T for way in (first, second)]
    return min(math.sqrt(np.square(places[0] - other).sum(axis=1).mean()) for other in (places[1], places[1][::-1]))


@pytest.mark.parametrize("paled", [1.0, 0.8])
@pytest.mark.parametrize("wrong", [way_of((-1.0, 6.0)), way_of((0.5, 0.2)), way_of((6.0, 1.0), (1.0, -2.5))])
def test_a_curved_way_is_found_wherever_the_own_one_ends(wrong, paled):
    light = texture(1)
    noise = 0.01 * np.random.default_rng(2).standard_normal((3, *SIZE))
    seen = 0.5 + paled * (moved_along(light, CURVED) - 0.5) + noise
    found = curved_way(ShakenPhoto(filed(light), filed(seen), None, 12.0, LIKELY, 400.0), wrong)
    assert found is not None and apart(found, CURVED) < 0.4


def test_the_own_way_is_left_where_it_explains_the_photo():
    light = texture(3)
    photo = filed(moved_along(light, CURVED))
    assert curved_way(ShakenPhoto(filed(light), photo, None, 12.0, LIKELY, 400.0), CURVED) is None
    backwards = CURVED * np.array([1, -1, 1, -1, 1])
    assert curved_way(ShakenPhoto(filed(light), photo, None, 12.0, LIKELY, 400.0), backwards) is None, (
        "direction of time"
    )


def test_a_long_way_is_found_beyond_the_shortest_lags():
    light, long = texture(4), way_of((22.0, 8.0), (-3.0, 6.0))
    likely = np.r_[np.inf, [20.0 / m**2 for m in range(1, ORDER + 1)]]
    found = curved_way(
        ShakenPhoto(filed(light), filed(moved_along(light, long)), None, 45.0, likely, 400.0), way_of((2.0, 2.0))
    )
    assert found is not None and apart(found, long) < 1.0


@pytest.mark.parametrize("straight", [12.0, 60.0])
def test_px_that_do_not_count_have_no_part_in_a_way(straight):
    light = texture(8)
    photo = filed(moved_along(light, CURVED))
    photo[:, 20:130, 90:] = filed(texture(9))[:, 20:130, 90:]  # something else walked into the picture
    counts = torch.ones(SIZE, dtype=torch.bool)
    counts[20:130, 90:] = False
    shaken = ShakenPhoto(filed(light), photo, counts, straight, LIKELY, 400.0)
    found = curved_way(shaken, way_of((-1.0, 6.0)))
    assert found is not None and apart(found, CURVED) < (0.4 if straight < 20 else 1.0)


@pytest.mark.parametrize("value", [0.5, math.nan])
def test_a_photo_without_anything_in_it_says_nothing(value):
    grey = torch.full((3, *SIZE), value)
    assert curved_way(ShakenPhoto(grey, grey, None, 8.0, LIKELY, 400.0), way_of((3.0, 1.0))) is None


@pytest.mark.parametrize("sigma", [4.0, 0.25])
def test_the_derivative_is_that_of_differences(sigma):
    light = texture(5)
    alike = Alike.of(filed(light), filed(moved_along(light, CURVED)), None, 32)
    explained = ExplainedPhoto(alike, LIKELY, 400.0)
    scale = explained.scale(sigma)
    explained.expect(CURVED.ravel(), scale)
    way = CURVED.ravel() + np.random.default_rng(6).normal(0.0, 0.7, 10)
    _, slope = explained.cost(way, scale)
    for index in range(10):
        step = np.eye(10)[index] * 1e-5
        high, low = (explained.cost(way + sign * step, scale)[0] for sign in (1, -1))
        assert slope[index] == pytest.approx((high - low) / 2e-5, rel=1e-4, abs=1e-8)


def test_what_is_left_counts_part_by_part():
    random = np.random.default_rng(7)
    own = 0.02 + 0.004 * random.standard_normal((60, 80))
    better = own - 0.001 + 0.0005 * random.standard_normal(own.shape)
    assert nearer(own, better, 10) > 5.0 and nearer(better, own, 10) < -5.0
    assert nearer(own, own, 10) == 0.0
    alike = np.repeat(np.repeat(random.standard_normal((6, 8)), 10, axis=0), 10, axis=1)  # (48 samples, not 4800)
    assert abs(nearer(own, own + alike, 10)) < 4.0
    assert nearer(np.full((4, 4), np.nan), own[:4, :4], 10) == 0.0


def test_px_that_do_not_count_are_left_out():
    photo = torch.zeros((3, 40, 40))
    seen = photo.clone()
    seen[:, :, 20:] = 0.5
    counts = torch.ones((40, 40), dtype=torch.bool)
    counts[:, 20:] = False
    assert np.nanmax(left_of(photo, seen, None, 1600)) == pytest.approx(0.5)
    assert np.nanmax(left_of(photo, seen, counts, 1600)) == 0.0
