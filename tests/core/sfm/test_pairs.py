"""Which photos are matched: by votes of their largest features, and by the order of their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.sfm import pairs as pairs_module
from dgs.core.sfm.features import UNIT
from dgs.core.sfm.pairs import _largest_features, _votes, choose_pairs
from dgs.core.sfm.settings import SfmSettings
from scipy.linalg import hadamard

from .models import database_of


def unit(*values: float) -> np.ndarray:
    vector = np.zeros(128, np.float32)
    vector[: len(values)] = values
    return vector / np.linalg.norm(vector)


def axes(*numbers: int) -> np.ndarray:
    """Descriptors at right angles to one another."""
    return np.eye(128, dtype=np.float32)[list(numbers)]


def test_every_feature_that_both_show_is_a_vote() -> None:
    votes = _votes([axes(0, 1, 2, 3), axes(2, 3, 4, 5, 6), axes(9, 2)], 2)
    assert votes.tolist() == [[0, 2, 1], [2, 0, 1], [1, 1, 0]]


def test_photos_with_one_feature_have_no_second_best() -> None:
    assert _votes([axes(0), axes(0, 1)], 1).tolist() == [[0, 0], [0, 0]]
    assert _votes([axes(0, 1), axes(0)], 1).tolist() == [[0, 0], [0, 0]]
    assert _votes([axes(0, 1), axes(0, 1)], 1).tolist() == [[0, 2], [2, 0]]


def test_neighbours_that_are_not_mutual_are_no_vote() -> None:
    """Both features of the first photo are nearest to one of the second."""
    first = np.stack([unit(1.0), unit(1.0, 0.1)])
    assert _votes([first, np.stack([unit(1.0), unit(0, 0, 1)])], 1)[0, 1] == 1


@pytest.mark.parametrize(("ratio", "votes"), [(0.80, 1), (0.90, 0)])
def test_a_vote_is_clearly_nearer_than_the_second_best(ratio: float, votes: int) -> None:
    """Distances on the unit sphere: 2 sin(half the angle)."""
    far = 2 * np.arcsin(0.3 / 2)
    near = 2 * np.arcsin(0.3 * ratio / 2)
    second = np.stack([unit(np.cos(near), np.sin(near)), unit(np.cos(far), -np.sin(far))])
    assert _votes([np.stack([unit(1.0), unit(0, 0, 1)]), second], 1)[0, 1] == votes


def test_the_largest_features_vote(tmp_path: Path) -> None:
    """COLMAP writes keypoints as x, y, scale, angle, or as x, y and a 2 x 2 matrix."""
    described = np.arange(4)[:, None].repeat(128, axis=1)
    four = np.array([[0, 0, 2, 0], [0, 0, 9, 0], [0, 0, 1, 0], [0, 0, 5, 0]])
    six = np.array([[0, 0, 3, 9, 4, 0], [0, 0, 0, 0, 6, 0], [0, 0, 1, 0, 1, 0], [0, 0, 7, 0, 0, 9]])
    database_of(tmp_path / "d.db", {"b.png": (four, described), "a.png": (six, described)})
    names, features = _largest_features(tmp_path / "d.db", 3)
    assert names == ["a.png", "b.png"]
    np.testing.assert_allclose(features[0][:, 0] * UNIT, [3, 1, 0])  # 7, 6, 5
    np.testing.assert_allclose(features[1][:, 0] * UNIT, [1, 3, 0])
    assert features[0].dtype == np.float32 and features[0].shape == (3, 128)


def codes() -> np.ndarray:
    """[127, 128] of length 512, each as far from every other: the rows of a Hadamard matrix, as 0 and 64."""
    return ((hadamard(128)[1:] + 1) * 32).astype(np.uint8)


def a_set(path: Path, shown: list[list[int]]) -> list[str]:
    """Photos by which of 127 features they show."""
    names = [f"{i:02d}.png" for i in range(len(shown))]
    points = {name: (np.ones((len(one), 4)), codes()[one]) for name, one in zip(names, shown, strict=True)}
    database_of(path, points)
    return names


def test_neighbours_in_the_order_of_names_are_matched_in_any_case(tmp_path: Path) -> None:
    names = a_set(tmp_path / "d.db", [[2 * i, 2 * i + 1] for i in range(20)])
    pairs = choose_pairs(tmp_path / "d.db", SfmSettings(partners=0))
    wanted = {(i, i + step) for step in (1, 2, 4) for i in range(20 - step)}
    assert pairs == [(names[a], names[b]) for a, b in sorted(wanted)]


def test_where_most_pairs_are_chosen_all_are_matched(tmp_path: Path) -> None:
    """Of n photos 3 n - 7 pairs are near in the order of names: 17 of 28 (0.61), or 11 of 15 (0.73)."""
    a_set(tmp_path / "8.db", [[2 * i, 2 * i + 1] for i in range(8)])
    assert choose_pairs(tmp_path / "8.db", SfmSettings(partners=0)) is not None
    a_set(tmp_path / "6.db", [[2 * i, 2 * i + 1] for i in range(6)])
    assert choose_pairs(tmp_path / "6.db", SfmSettings(partners=0)) is None


def far_apart(pairs: list[tuple[str, str]] | None) -> set[tuple[int, int]]:
    """Those that are not near in the order of names."""
    assert pairs is not None
    found = {(int(a[:2]), int(b[:2])) for a, b in pairs}
    return {(a, b) for a, b in found if b - a not in (1, 2, 4)}


def test_photos_that_share_features_are_matched(tmp_path: Path) -> None:
    shown = [[3 * i, 3 * i + 1] for i in range(20)]
    for photo in (2, 17):
        shown[photo] = shown[photo] + [120, 121, 122]
    a_set(tmp_path / "d.db", shown)
    # One partner each by rank alone; of photos that share nothing that is the first in the order of names.
    found = far_apart(choose_pairs(tmp_path / "d.db", SfmSettings(partners=2, minimum_votes=99)))
    assert found == {(2, 17)} | {(0, i) for i in range(3, 20) if i not in (4, 17)}


def test_of_those_that_beat_chance_some_all_over_the_rest_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the partners are the best; the others are spread over those with more votes than the least."""
    names = [f"{i:02d}.png" for i in range(20)]
    votes = np.zeros((20, 20))
    votes[19, [2, 4, 6, 8, 10, 12]] = 9, 8, 7, 6, 5, 4
    monkeypatch.setattr(pairs_module, "_largest_features", lambda *_: (names, []))
    monkeypatch.setattr(pairs_module, "_votes", lambda *_: votes)

    def of_the_last(**settings: int) -> set[int]:
        return {a for a, b in far_apart(choose_pairs(Path(), SfmSettings(**settings))) if b == 19}

    assert of_the_last(partners=4, minimum_votes=4, many=21) == {
        2,
        4,
        6,
        10,
    }  # not 12, which has no more than the least
    assert of_the_last(partners=4, minimum_votes=3, many=21) == {2, 4, 6, 12}
    assert of_the_last(partners=6, minimum_votes=4, many=21) == {2, 4, 6, 8, 10}
    assert of_the_last(partners=3, minimum_votes=4, many=21) == {2, 4, 10}
    assert of_the_last(partners=0, many_partners=4, minimum_votes=4, many=20) == {2, 4, 6, 10}
    assert of_the_last(partners=0, many_partners=4, minimum_votes=4, many=21) == set()
    votes[:19, :19] = 6.0  # chance: what a pair has by the median
    assert of_the_last(partners=6, minimum_votes=1, many=21) == {2, 4, 6}
