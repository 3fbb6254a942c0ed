"""How the photos that are no key photos are placed, on models whose every number is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.sfm import keyframes
from dgs.core.sfm.keyframes import (
    Matches,
    _by_matches,
    _joined,
    _points_of_features,
    _turned_in,
    choose_keyframes,
    place_others,
    read_matches,
)
from dgs.core.sfm.settings import FILTERED, RefineSettings

from .models import FOCAL, HEIGHT, WIDTH, database_of, geometry_of, model_of, pixels_of, rigid
from .test_refine import picture, waves

CENTRES = [(-0.4, 0.0, 0.0), (0.0, 0.1, 0.0), (0.4, -0.1, 0.3)]
NEW = (0.1, 0.2, -0.2)


def scattered(count: int, depth: float = 4.0) -> np.ndarray:
    """[count, 3] about a plane; apart by more than 2 px in every photo."""
    side = int(np.ceil(np.sqrt(count)))
    at = np.linspace(-1.5, 1.5, side)
    x, y = np.meshgrid(at, at * 0.7)
    z = depth + 0.3 * np.sin(7 * x) * np.cos(5 * y)
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)[:count]


def known(points: np.ndarray, others: int = 1, shared: int | None = None) -> Matches:
    """Three key photos, and `others` that see all points; features are the points in their order."""
    names = {i: f"0/{i:04d}.png" for i in range(1, 4 + others)}
    keypoints = {i + 1: pixels_of(centre, points) for i, centre in enumerate([*CENTRES, *[NEW] * others])}
    both = np.arange(len(points) if shared is None else shared)[:, None].repeat(2, axis=1)
    pairs = {(1, i): both for i in range(4, 4 + others)}
    return Matches(names, dict.fromkeys(names, 1), keypoints, pairs)


def test_a_database_is_read(tmp_path) -> None:
    features = {name: (np.arange(20.0).reshape(5, 4), np.zeros((5, 128))) for name in "ab"}
    features["c"] = (np.arange(30.0).reshape(5, 6), np.zeros((5, 128)))
    pairs = {("a", "c"): geometry_of([(0, 1), (2, 3)]), ("a", "b"): geometry_of([])}
    numbers = database_of(tmp_path / "d.db", features, pairs)
    found = read_matches(tmp_path / "d.db")
    assert found.names == {number: name for name, number in numbers.items()}
    assert list(found.pairs) == [(numbers["a"], numbers["c"])]
    assert found.pairs[numbers["a"], numbers["c"]].tolist() == [[0, 1], [2, 3]]
    assert found.keypoints[numbers["b"]].tolist() == [[0, 1], [4, 5], [8, 9], [12, 13], [16, 17]]
    assert found.keypoints[numbers["c"]].shape == (5, 2) and len(set(found.cameras.values())) == 3


def test_features_show_the_point_that_is_nearest() -> None:
    points = scattered(9)
    model = model_of(CENTRES, points, seen_by=[(1, 2, 3)] * 8 + [(2, 3)])
    matches = known(points)
    matches.keypoints[1][0] += [1.9, 0.0]
    matches.keypoints[1][1] += [0.0, -2.1]
    found = _points_of_features(model, matches)
    ids = sorted(model.point3D_ids())
    assert set(found) == {1, 2, 3}
    assert found[1].tolist() == [ids[0], -1, *ids[2:8], -1] and found[2].tolist() == ids
    matches.keypoints[3] = np.zeros((0, 2))
    assert _points_of_features(model, matches)[3].tolist() == []


@pytest.mark.parametrize(("shared", "placed"), [(12, True), (11, False), (0, False)])
def test_a_photo_is_placed_by_a_dozen_matches(shared: int, placed: bool) -> None:
    points = scattered(30)
    model, matches = model_of(CENTRES, points), known(points, shared=shared)
    shown = _points_of_features(model, matches)
    pose = _by_matches(4, model, matches, shown, model.cameras[1], FILTERED)
    assert (pose is not None) == placed
    if pose is not None:
        np.testing.assert_allclose(pose.translation, -np.array(NEW), atol=1e-6)
        np.testing.assert_allclose(pose.rotation.matrix(), np.eye(3), atol=1e-6)


def test_matches_count_on_both_sides_and_only_with_key_photos() -> None:
    points = scattered(30)
    model, matches = model_of(CENTRES, points), known(points)
    six = [np.arange(k, k + 6)[:, None].repeat(2, axis=1) for k in (0, 6, 12)]
    order = {**matches.names, 0: "0/0000.png"}
    first = replace(
        matches,
        names=order,
        cameras=dict.fromkeys(order, 1),
        keypoints={**matches.keypoints, 0: pixels_of(NEW, points)},
        pairs={(0, 1): six[0], (0, 2): six[1], (0, 4): six[2], (1, 2): six[2]},
    )
    shown = _points_of_features(model, first)
    pose = _by_matches(0, model, first, shown, model.cameras[1], FILTERED)
    assert pose is not None
    np.testing.assert_allclose(pose.translation, -np.array(NEW), atol=1e-6)
    less = replace(first, pairs={(0, 1): six[0], (0, 4): six[1], (1, 2): six[2]})
    assert _by_matches(0, model, less, shown, model.cameras[1], FILTERED) is None


def test_matches_that_disagree_place_nothing() -> None:
    points = scattered(30)
    model, matches = model_of(CENTRES, points), known(points)
    matches.keypoints[4] = np.random.default_rng(0).uniform(0, 150, (30, 2))
    shown = _points_of_features(model, matches)
    assert _by_matches(4, model, matches, shown, model.cameras[1], FILTERED) is None


def test_a_pose_is_turned_in_and_says_what_fits() -> None:
    points = scattered(30)
    model = model_of(CENTRES, points)
    pixels = pixels_of(NEW, points)
    pixels[3] += [2.5, 0.0]
    pixels[4] += [0.0, 1.5]
    start = rigid(np.array(NEW) + [0.02, -0.03, 0.01])
    pose, good = _turned_in(start, points, pixels, model.cameras[1], 2.0)
    np.testing.assert_allclose(pose.translation, -np.array(NEW), atol=5e-3)
    assert np.flatnonzero(~good).tolist() == [3]
    exact, _ = _turned_in(start, points, pixels_of(NEW, points), model.cameras[1], 2.0)
    np.testing.assert_allclose(exact.translation, -np.array(NEW), atol=1e-6)


def test_what_does_not_fit_has_no_say_in_the_end() -> None:
    """A fifth of the points far off to one side: without them the pose is exact."""
    points = scattered(40)
    model, pixels = model_of(CENTRES, points), pixels_of(NEW, points)
    pixels[::5] += [15.0, 9.0]
    pose, good = _turned_in(rigid(np.array(NEW) + [0.01, -0.02, 0.01]), points, pixels, model.cameras[1], 4.0)
    np.testing.assert_allclose(pose.translation, -np.array(NEW), atol=1e-6)
    assert np.flatnonzero(~good).tolist() == list(range(0, 40, 5))


def test_few_points_turn_nothing() -> None:
    points = scattered(12)
    model, start = model_of(CENTRES, points), rigid((0.0, 0.0, 0.0))
    pose, good = _turned_in(start, points[:11], pixels_of(NEW, points[:11]), model.cameras[1], 2.0)
    assert pose is start and len(good) == 11 and not good.any()
    assert _turned_in(start, points, pixels_of(NEW, points), model.cameras[1], 2.0)[1].all()


def test_points_behind_the_photo_do_not_fit() -> None:
    points = np.concatenate([scattered(29), [[0.3, 0.2, -4.0]]])
    model = model_of(CENTRES, points)
    _, good = _turned_in(rigid(NEW), points, pixels_of(NEW, points), model.cameras[1], 2.0)
    assert np.flatnonzero(~good).tolist() == [29]


def test_photos_join_a_copy_of_the_model() -> None:
    points = scattered(9)
    model, matches = model_of(CENTRES, points), known(points, 2)
    ids = np.array(sorted(model.point3D_ids()))
    sightings = {5: (ids[[2, 7]], pixels_of(NEW, points)[[2, 7]])}
    result = _joined(model, matches, {5: rigid(NEW), 4: rigid((1.0, 0.0, 0.0))}, sightings)
    assert model.num_reg_images() == 3 and result.num_reg_images() == 5
    assert result.images[5].name == "0/0005.png" and len(result.images[4].points2D) == 0
    np.testing.assert_allclose(result.images[5].projection_center(), NEW)
    assert [p.point3D_id for p in result.images[5].points2D] == ids[[2, 7]].tolist()
    assert result.points3D[int(ids[2])].track.length() == 4 and model.points3D[int(ids[2])].track.length() == 3


def flat(count: int) -> np.ndarray:
    points = scattered(count)
    points[:, 2] = 4.0
    points[:, :2] *= 0.7
    return points


def photos(matches: Matches) -> dict[str, np.ndarray]:
    """Of the plane z = 4."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    greys = {}
    for number, name in matches.names.items():
        centre = CENTRES[number - 1] if number < 4 else NEW
        far = (4.0 - centre[2]) / FOCAL
        greys[name] = waves(40 * ((u - WIDTH / 2) * far + centre[0]), 40 * ((v - HEIGHT / 2) * far + centre[1])).astype(
            np.float32
        )
    return greys


def test_the_others_become_as_exact_as_the_key_photos() -> None:
    points = flat(49)
    model, matches = model_of(CENTRES, points), known(points)
    noise = np.random.default_rng(0)
    matches.keypoints[4] += noise.uniform(-1.0, 1.0, (49, 2))
    placed: list[int] = []
    result = place_others(model, matches, photos(matches), FILTERED, RefineSettings(), lambda: placed.append(1))
    assert len(placed) == 1 and result.num_reg_images() == 4
    # (The adjustment of all may move, turn and scale the world: the new photo is seen against the others.)
    centres = np.array([result.images[i].projection_center() for i in (1, 2, 3, 4)])
    true = np.array([*CENTRES, NEW])
    shares, wanted = (np.linalg.norm(c[3] - c[:3], axis=1) / np.linalg.norm(c[0] - c[2]) for c in (centres, true))
    np.testing.assert_allclose(shares, wanted, atol=0.01)
    assert sum(p.has_point3D() for p in result.images[4].points2D) > 30


def test_too_many_that_find_no_place_are_none() -> None:
    points = flat(30)
    model, matches = model_of(CENTRES, points), known(points, 2, shared=5)
    assert place_others(model, matches, photos(matches), FILTERED, RefineSettings()) is None  # 2 of 5
    strange = known(points)
    strange.cameras[4] = 9
    assert place_others(model, strange, photos(strange), FILTERED, RefineSettings()) is None


def test_one_in_twenty_may_find_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    points = flat(30)
    asked: list[set[int]] = []
    monkeypatch.setattr(keyframes, "_by_patches", lambda *given: asked.append(set(given[2])) or "joined")
    for others, answer in ((17, "joined"), (16, None)):  # one of 20, or of 19
        matches = known(points, others)
        matches.pairs[1, 4] = matches.pairs[1, 4][:5]
        assert place_others(model_of(CENTRES, points), matches, {}, FILTERED, RefineSettings()) == answer
    assert asked == [set(range(5, 21))]


# --- the choice -------------------------------------------------------------------------------------------------------


def tied(count: int, ties: dict[tuple[int, int], int]) -> Matches:
    names = {i: f"{i:02d}" for i in range(1, count + 1)}
    empty = dict.fromkeys(names, np.zeros((0, 2)))
    return Matches(names, dict.fromkeys(names, 1), empty, {p: np.zeros((n, 2), int) for p, n in ties.items()})


def test_who_is_tied_the_most_is_left_out_first() -> None:
    """Six photos, each with each: with four key photos everybody has three partners among them."""
    ties = {(a, b): 20 for a in range(1, 7) for b in range(a + 1, 7)}
    ties |= {(2, b): 40 for b in (3, 4, 6)} | {(1, 2): 40, (1, 5): 30, (2, 5): 50, (5, 6): 25}
    chosen = choose_keyframes(tied(6, ties), 15)
    assert chosen == ["01", "03", "04", "06"]  # 2 shares 210, then 5 of what is left 95, 1 but 90


def test_nothing_tied_is_none() -> None:
    assert choose_keyframes(tied(4, {(1, 2): 14, (3, 4): 3}), 15) is None
    assert choose_keyframes(tied(4, {}), 15) is None


def test_names_decide_not_numbers() -> None:
    ties = {(a, b): 20 for a in range(1, 7) for b in range(a + 1, 7)}
    usual = choose_keyframes(tied(6, ties), 20)
    matches = tied(6, ties)
    turned = replace(matches, names={i: f"{7 - i:02d}" for i in matches.names})
    assert usual == choose_keyframes(turned, 20) == ["03", "04", "05", "06"]
    assert choose_keyframes(matches, 21) is None


def test_pictures_are_what_they_seem() -> None:
    """Of the other file's texture, here on a plane."""
    assert picture().shape == (HEIGHT, WIDTH) and photos(known(flat(4)))["0/0001.png"].std() > 0.05
