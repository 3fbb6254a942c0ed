"""Haze from points that are drawn by the law itself, among gains, gloss and directions of view."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.inspection.haze_fit import HazeFit, fit_haze
from dgs.core.inspection.observations import PointObservations

POINTS, PHOTOS, BLOCKS = 400, 12, 40


def fitted(
    depth: float = 0.0, veil: float = 0.6, turned: float = 0.0, gloss: float = 0.0, nearer: float = 5.0
) -> HazeFit:
    """Of points seen from an arc of cameras at different distances.

    Args:
        depth: optical depth at the median distance; veil: the medium's own light.
        turned: relative change of all points' light per radian of the direction of view.
        gloss: the same of each region's own, at random.
        nearer: how far the arc leads towards the points; 0 leaves their distances nearly alike.
    """
    random = np.random.default_rng(3)
    positions = random.uniform([-2, -2, 4], [2, 2, 8], (POINTS, 3))
    angle = np.linspace(-0.6, 0.6, PHOTOS)
    cameras = np.stack(
        [(0.8 * nearer) * np.sin(angle), random.uniform(-0.5, 0.5, PHOTOS), nearer * (1 - np.cos(angle))], axis=1
    )
    point, photo = (a.ravel() for a in np.mgrid[:POINTS, :PHOTOS])
    away = cameras[photo] - positions[point]
    way = np.linalg.norm(away, axis=1)
    direction, distance = away / way[:, None], way / np.median(way)
    block = (point * BLOCKS) // POINTS
    own = gloss * random.standard_normal((BLOCKS, 3))
    light = random.uniform(0.05, 0.8, (POINTS, 3))[point]
    light = light * (1 + turned * direction[:, :1] + (own[block] * direction).sum(axis=1, keepdims=True))
    passed = np.exp(-depth * distance)[:, None]
    light = light * passed + veil * (1 - passed)
    light = light * np.exp(0.1 * random.standard_normal(PHOTOS))[photo, None]
    light = light * (1 + 0.01 * random.standard_normal(light.shape))
    radius, pixel = random.uniform(0, 0.9, len(point)), np.zeros((len(point), 2))
    names = tuple(str(i) for i in range(PHOTOS))
    return fit_haze(PointObservations(point, photo, light, distance, distance, radius, direction, pixel, block, names))


@pytest.mark.parametrize("depth", [0.1, 0.3, 0.6])
def test_attenuation_and_added_light_are_found(depth: float) -> None:
    found = fitted(depth)
    assert found.attenuation.mean() == pytest.approx(depth, rel=0.1, abs=0.02)
    assert found.backscatter.mean() == pytest.approx(0.6 * depth, rel=0.25)  # (linear in the depth: 1 - exp(-d) < d)


@pytest.mark.parametrize("turned", [-0.2, 0.2])
def test_light_that_changes_with_the_direction_alone_is_no_haze(turned: float) -> None:
    found = fitted(turned=turned)
    assert abs(found.attenuation.mean()) < 2.5 * found.attenuation_error + 0.01
    assert abs(found.backscatter.mean()) < 2.5 * found.backscatter_error + 0.005


def test_gloss_of_regions_shows_in_the_errors() -> None:
    quiet, glossy = fitted(0.2), fitted(0.2, gloss=0.3)
    assert glossy.attenuation_error > 3 * quiet.attenuation_error
    assert abs(glossy.attenuation.mean() - 0.2) < 2.5 * glossy.attenuation_error


def test_distances_that_are_nearly_alike_show_no_added_light() -> None:
    far, near = fitted(0.3), fitted(0.3, nearer=0.3)
    assert near.backscatter_error > 3 * far.backscatter_error
    assert near.backscatter.mean() < 2.5 * near.backscatter_error
