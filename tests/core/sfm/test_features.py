"""Features that are kept with a twin: written, read, matched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from dgs.core.sfm.features import UNIT, Features, load_features, matched, save_features
from dgs.core.sfm.settings import Recipe


def some(seed: int, count: int, content: str = "") -> Features:
    random = np.random.default_rng(seed)
    vectors = np.abs(random.normal(size=(count, 128)))
    vectors *= UNIT / np.linalg.norm(vectors, axis=1, keepdims=True)
    return Features(random.uniform(0, 500, (count, 2)).astype(np.float32), vectors.round().astype(np.uint8), content)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    wanted = {"ä b.png": some(0, 7, "a digest"), "none.png": some(1, 0), "c.png": some(2, 3)}
    save_features(tmp_path / "features.npz", wanted, Recipe("r", "why", image_size=300))
    found = load_features(tmp_path / "features.npz")
    assert found is not None and found[1] == Recipe("r", "why", image_size=300) and set(found[0]) == set(wanted)
    for name, one in wanted.items():
        assert np.array_equal(found[0][name].positions, one.positions)
        assert np.array_equal(found[0][name].descriptors, one.descriptors)
        assert found[0][name].content == one.content


def test_features_are_those_of_one_photo_only() -> None:
    assert some(0, 3, "a").shown_by("a") and not some(0, 3, "a").shown_by("b")
    assert not some(0, 3).shown_by(""), "a digest that is not known is nobody's"


def test_a_damaged_or_missing_file_is_none(tmp_path: Path) -> None:
    save_features(tmp_path / "features.npz", {"a": some(0, 7)}, Recipe("r", "why"))
    content = (tmp_path / "features.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(content[: len(content) // 2])
    (tmp_path / "text.npz").write_text("no features")
    assert [load_features(tmp_path / name) for name in ("cut.npz", "text.npz", "missing.npz")] == [None] * 3


def test_equal_features_match_and_ambiguous_ones_do_not() -> None:
    first = some(0, 40)
    order = np.random.default_rng(3).permutation(40)
    second = Features(first.positions[order], first.descriptors[order])
    pairs = matched(first, second)
    assert len(pairs) == 40 and np.array_equal(order[pairs[:, 1]], pairs[:, 0])
    twice = Features(np.concatenate([first.positions] * 2), np.concatenate([first.descriptors] * 2))
    assert len(matched(first, twice)) == 0
    assert len(matched(first, some(9, 40))) < 5 and len(matched(first, some(1, 1))) == 0
