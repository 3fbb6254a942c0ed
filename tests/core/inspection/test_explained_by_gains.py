"""Exposure moves all points of a photo alike; gloss moves each its own way."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.inspection.observations import PointObservations
from dgs.core.inspection.photometry import explained_by_gains

POINTS, PHOTOS = 200, 12


def observed(light: np.ndarray) -> PointObservations:
    """Every point in every photo, light [POINTS, PHOTOS, 3]."""
    point, photo = (a.ravel() for a in np.mgrid[:POINTS, :PHOTOS])
    n = len(point)
    return PointObservations(
        point, photo, light.reshape(n, 3), np.ones(n), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 2)), point
    )


def lights(gain: float, own: float) -> tuple[np.ndarray, np.ndarray]:
    """Light [POINTS, PHOTOS, 3] whose logarithm differs by photo and by point and photo, and the photos' gains."""
    random = np.random.default_rng(0)
    colour = random.uniform(0.1, 0.8, (POINTS, 1, 3))
    gains = gain * random.standard_normal((PHOTOS, 3))
    each = own * random.standard_normal((POINTS, PHOTOS, 1))
    return colour * np.exp(gains + each), gains - gains.mean(axis=0)


def test_gains_explain_all_where_nothing_else_differs() -> None:
    light, gains = lights(0.2, 0.0)
    assert explained_by_gains(observed(light), gains) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("own", [0.1, 0.2, 0.4])
def test_they_explain_their_share_of_the_variance(own: float) -> None:
    light, gains = lights(0.2, own)
    share = np.var(gains) / (np.var(gains) + own**2 * (1 - 1 / PHOTOS))
    assert explained_by_gains(observed(light), gains) == pytest.approx(share, abs=0.06)


def test_gains_that_are_not_there_explain_less_than_nothing() -> None:
    light, _ = lights(0.0, 0.05)
    wrong = lights(0.2, 0.0)[1]
    assert explained_by_gains(observed(light), wrong) < 0.0


def test_photos_without_any_difference() -> None:
    light, _ = lights(0.0, 0.0)
    assert explained_by_gains(observed(light), np.zeros((PHOTOS, 3))) == 0.0
