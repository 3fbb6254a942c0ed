"""Exposure moves all points of a photo alike; gloss moves those of one region."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.inspection.observations import PointObservations
from dgs.core.inspection.photometry import explained_elsewhere
from scipy.stats import norm

POINTS, PHOTOS, BLOCKS = 200, 30, 50


def explained(gain: float, gloss: float, noise: float = 0.02, blocks: int = BLOCKS, points: int = POINTS) -> float:
    """Of points whose light differs by photo (`gain`), by photo and region (`gloss`), and by itself (`noise`)."""
    random = np.random.default_rng(1)
    point, photo = (a.ravel() for a in np.mgrid[:points, :PHOTOS])
    block = point % blocks
    gains = gain * norm.ppf((random.permutation(PHOTOS) + 0.5) / PHOTOS)
    log = np.log(random.uniform(0.1, 0.8, points))[point] + gains[photo]
    log += gloss * random.standard_normal((blocks, PHOTOS))[block, photo] + noise * random.standard_normal(len(point))
    light = np.exp(log)[:, None] * np.array([1.0, 0.9, 0.8])
    n, names = len(point), tuple(str(i) for i in range(PHOTOS))
    return explained_elsewhere(
        PointObservations(
            point, photo, light, np.ones(n), np.ones(n), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 2)), block, names
        )
    )


def test_gains_are_the_same_everywhere() -> None:
    assert explained(0.2, 0.0, 0.0) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
def test_they_explain_their_share_of_the_variance(noise: float) -> None:
    assert explained(0.2, 0.0, noise) == pytest.approx(0.04 / (0.04 + noise**2), abs=0.08)


@pytest.mark.parametrize("gloss", [0.1, 0.3])
def test_gloss_of_regions_explains_nothing_elsewhere(gloss: float) -> None:
    assert explained(0.0, gloss) < 0.05


def test_noise_explains_nothing() -> None:
    assert explained(0.0, 0.0, 0.1) == pytest.approx(0.0, abs=0.05)


def test_one_region_alone_says_nothing() -> None:
    assert explained(0.2, 0.0, blocks=1) == 0.0


@pytest.mark.parametrize(("points", "enough"), [(9, False), (24, True)])
def test_a_few_points_say_nothing(points: int, enough: bool) -> None:
    """Half of them are in each half of space: four of a photo do not make a gain."""
    assert (explained(0.2, 0.0, points=points) > 0.5) == enough
