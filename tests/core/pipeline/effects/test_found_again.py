"""Whether two trainings find the same paths."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.pipeline.effects.found_again import SETTINGS, found_again

_TIMES = np.linspace(-1.0, 1.0, 17)


def straight(angle: float, length: float = 8.0, bend: float = 0.0) -> np.ndarray:
    """[17, 2] px."""
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    return length / 2 * (_TIMES[:, None] * along + bend * _TIMES[:, None] ** 2 * across)


def named(ways) -> dict[str, np.ndarray]:
    """By photo."""
    return {f"{i:03d}.png": way for i, way in enumerate(ways)}


@pytest.fixture
def angles() -> np.ndarray:
    """Of twelve photos."""
    return np.random.default_rng(3).uniform(0.0, 2 * np.pi, 12)


def test_paths_that_lie_elsewhere_and_lead_the_other_way_are_the_same(angles):
    ways = [straight(angle, bend=0.3) for angle in angles]
    moved = [way[::-1] + (5.0, -2.0) for way in ways]
    found = found_again(named(ways), named(moved))
    assert found.apart < 1e-9 and found.chance < 0.01 and found.confirms


def test_a_third_of_noise_is_the_same_path_still(angles):
    random = np.random.default_rng(5)
    noisy = [
        straight(angle) + 0.3 * np.linalg.norm(straight(angle), axis=1).mean() * shape
        for angle in angles
        for shape in [random.normal(size=2) * _TIMES[:, None] ** 2]
    ]
    found = found_again(named([straight(angle) for angle in angles]), named(noisy))
    assert 0.02 < found.apart < SETTINGS.apart and found.confirms


def test_paths_in_any_direction_differ_as_the_limit_says():
    random = np.random.default_rng(4)
    ways = [[straight(angle) for angle in random.uniform(0.0, 2 * np.pi, 600)] for _ in range(2)]
    found = found_again(named(ways[0]), named(ways[1]))
    assert found.apart == pytest.approx(0.77, abs=0.05) and not found.confirms


def test_what_all_photos_share_is_no_path_of_their_own(angles):
    """Blur of a medium, or what a twin lacks in one direction: any photo's path does for any other."""
    ways = named([straight(0.4) for _ in angles])
    found = found_again(ways, ways)
    assert found.apart < 1e-9 and found.chance == 1.0 and not found.confirms


def test_a_path_of_another_extent_is_another(angles):
    ways, longer = ([straight(angle, length) for angle in angles] for length in (2.0, 8.0))
    assert not found_again(named(ways), named(longer)).confirms


def test_photos_that_stood_still_confirm_nothing(angles):
    still = named([np.zeros((17, 2)) for _ in angles])
    found = found_again(still, still)
    assert np.isfinite(found.apart) and not found.confirms
    assert not found_again(still, named([straight(angle) for angle in angles])).confirms


def test_of_few_photos_nothing_is_said(angles):
    ways = named([straight(angle) for angle in angles])
    few = dict(list(ways.items())[: SETTINGS.fewest - 1])
    assert found_again(ways, few) is None and found_again({}, {}) is None
    assert found_again(ways, dict(list(ways.items())[: SETTINGS.fewest])) is not None
