"""Whether two trainings find the same paths."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.pipeline.effects.comparison import SETTINGS as TRIALS
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


def test_paths_in_any_direction_differ_as_those_of_different_photos():
    random = np.random.default_rng(4)
    ways = [[straight(angle) for angle in random.uniform(0.0, 2 * np.pi, 400)] for _ in range(2)]
    found = found_again(named(ways[0]), named(ways[1]))
    assert found.apart == pytest.approx(1.0, abs=0.05) and found.chance > 0.03 and not found.confirms


def test_what_all_photos_share_is_no_path_of_their_own(angles):
    """Blur of a medium, or what a twin lacks in one direction: any photo's path does for any other."""
    ways = named([straight(0.4) for _ in angles])
    assert found_again(ways, ways) is None
    noisy = named([straight(0.4 + 0.1 * (i % 3)) for i in range(len(angles))])
    shared = found_again(ways, noisy)
    assert shared.apart == pytest.approx(1.0) and shared.chance > 0.5 and not shared.confirms


def test_a_path_of_another_extent_is_another(angles):
    ways, longer = ([straight(angle, length) for angle in angles] for length in (2.0, 8.0))
    assert not found_again(named(ways), named(longer)).confirms


def test_photos_that_stood_still_confirm_nothing(angles):
    still = named([np.zeros((17, 2)) for _ in angles])
    assert found_again(still, still) is None
    assert not found_again(still, named([straight(angle) for angle in angles])).confirms


def test_a_few_that_moved_among_many_that_stood_still_are_enough(angles):
    ways = [straight(angle) if i < 4 else np.zeros((17, 2)) for i, angle in enumerate(angles)]
    other = [way + 0.05 * np.random.default_rng(i).normal(size=way.shape) for i, way in enumerate(ways)]
    assert found_again(named(ways), named(other)).confirms


def test_of_few_photos_nothing_is_said(angles):
    ways = named([straight(angle) for angle in angles])
    few = dict(list(ways.items())[: SETTINGS.fewest - 1])
    assert found_again(ways, few) is None and found_again({}, {}) is None
    assert found_again(ways, dict(list(ways.items())[: SETTINGS.fewest])) is not None


def test_one_photo_that_moved_is_not_enough(angles):
    """A long path that is found again among paths that are not: some orders of the photos agree as well."""
    random = np.random.default_rng(6)
    ways = [[straight(angle, 0.6) for angle in random.uniform(0.0, 2 * np.pi, 8)] for _ in range(2)]
    ways[0][0] = ways[1][0] = straight(0.3, 16.0)
    found = found_again(named(ways[0]), named(ways[1]))
    assert found.apart < SETTINGS.apart and found.chance > TRIALS.chance and not found.confirms
