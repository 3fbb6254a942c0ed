"""Which model is believed, which one is kept, and why none was."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
from dgs.core.reconstruction import CONTRADICTED, Attempt
from dgs.core.sfm import attempts
from dgs.core.sfm.attempts import explain, judge, lighter, run, widest_angle
from dgs.core.sfm.features import FEATURES, load_features
from dgs.core.sfm.job import SfmJob
from dgs.core.sfm.mapping import PairGeometry
from dgs.core.sfm.settings import PLAIN, SfmSettings, recipes

from .models import FOCAL, database_of, grid_points, model_of

GOOD = PairGeometry(images=4, verified=6, connected=4, flat=0.0, rotating=0.0)
RECIPE = recipes(True)[0]


def row(count: int, step: float = 0.5) -> list[tuple[float, float, float]]:
    return [(i * step, 0.0, 0.0) for i in range(count)]


def verdict(model: Any, geometry: PairGeometry = GOOD) -> str:
    return judge(model, geometry, SfmSettings(), RECIPE).verdict


def test_a_good_model_is_trusted_and_its_figures_are_said() -> None:
    found = judge(model_of(row(4), grid_points(40), off=0.25), GOOD, SfmSettings(), RECIPE)
    assert found.verdict == "trusted" and (found.name, found.reason) == (RECIPE.name, RECIPE.reason)
    assert (found.registered, found.points, found.focal_px) == (4, 40, FOCAL)
    assert found.reprojection_px == pytest.approx(0.25, rel=1e-6)
    assert 15.0 < found.angle_deg < 25.0


@pytest.mark.parametrize(
    ("count", "change", "said"),
    [
        (4, {"images": 5}, "trusted"),
        (3, {"images": 4}, "trusted"),
        (4, {"images": 6}, "incomplete"),
        (4, {"images": 16}, "incomplete"),
        (4, {"images": 17}, "too few photos joined"),
        (2, {"images": 4}, "too few photos joined"),
        (1, {"images": 4}, "no model"),
        (4, {"rotating": 0.81}, "the camera only turned"),
        (4, {"rotating": 0.8}, "trusted"),
    ],
)
def test_how_many_photos_joined(count: int, change: dict[str, Any], said: str) -> None:
    assert verdict(model_of(row(count), grid_points(40)), replace(GOOD, **change)) == said


def test_what_a_model_must_be() -> None:
    assert verdict(None) == "no model"
    some = grid_points(40)
    assert verdict(model_of(row(4), some, focal=39.0)) == "implausible focal length"  # 0.195 of 200 px
    assert verdict(model_of(row(4), some, focal=41.0)) == "trusted"
    assert verdict(model_of(row(4), some, focal=1601.0)) == "implausible focal length"
    assert verdict(model_of(row(4), some, focal=1599.0)) == "trusted"
    assert verdict(model_of(row(4), some, off=1.6)) == "large reprojection error"
    assert verdict(model_of(row(4), some, off=1.4)) == "trusted"
    assert verdict(model_of(row(4, 0.02), some)) == "rays too parallel"
    assert verdict(model_of(row(4), grid_points(19))) == "too few points"
    assert verdict(model_of(row(4), grid_points(20))) == "trusted"


def test_the_widest_angle_at_a_point() -> None:
    centres = [(-4.0, 0.0, 0.0), (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)]
    points = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 40.0]])
    model = model_of(centres, points, seen_by=[(1, 2, 3), (1, 2), (1, 2)])
    assert widest_angle(model) == pytest.approx(45.0)  # of 90, 45, and 5.7
    wide = model_of([(-8.0, 0.0, 0.0), (8.0, 0.0, 0.0)], points[:1])
    assert widest_angle(wide) == pytest.approx(2 * np.degrees(np.arctan(2.0)))  # 127
    assert widest_angle(model_of(centres, np.zeros((0, 3)))) == 0.0


def test_of_many_points_about_a_thousand_are_asked() -> None:
    """Every second of 2000: those that are seen under 90 degrees."""
    points = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 400.0]] * 1000)
    centres = [(-4.0, 0.0, 0.0), (4.0, 0.0, 0.0)]
    assert widest_angle(model_of(centres, points)) == pytest.approx(90.0)


def job(folder: Path, count: int = 5, **changes: Any) -> SfmJob:
    kernel = np.outer(*[np.array([0.25, 0.5, 0.25])] * 2)
    images = {f"0/{i:04d}.png": folder / f"{i}.npy" for i in range(count)}
    return SfmJob(folder, images, {}, False, changes.pop("kernel", kernel), SfmSettings(**changes))


class Tries:
    """Attempts whose models are made beforehand, each with a database of one photo."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *results: tuple[Any, PairGeometry]) -> None:
        self.results, self.said = list(results), []
        monkeypatch.setattr(attempts, "_try", self.one)

    def one(self, job: SfmJob, recipe: Any, index: int, say: Any) -> tuple[Any, PairGeometry]:
        (job.folder / f"try{index}").mkdir()
        descriptors = np.full((index + 1, 128), 45, np.uint8)
        database_of(job.folder / f"try{index}" / attempts.DATABASE, {"a": (np.ones((index + 1, 4)), descriptors)})
        return self.results[index]

    def say(self, **message: Any) -> None:
        self.said.append(message)


FIVE = replace(GOOD, images=5)


def test_the_model_with_the_most_photos_is_kept_with_its_features(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small, large = (model_of(row(n), grid_points(30)) for n in (3, 4))
    failed = model_of(row(4), grid_points(30), off=3.0)
    tries = Tries(monkeypatch, (small, FIVE), (failed, FIVE), (large, replace(FIVE, images=6)), (None, FIVE))
    result = run(job(tmp_path), tries.say)
    assert result.kind == "done" and result.message["registered"] == 4 and result.message["verdict"] == "incomplete"
    assert [m["attempt"]["verdict"] for m in tries.said] == [
        "incomplete",
        "large reprojection error",
        "incomplete",
        "no model",
    ]
    assert result.message == tries.said[2]["attempt"] and result.message["seconds"] >= 0.0
    assert pycolmap.Reconstruction(str(tmp_path / "best")).num_reg_images() == 4
    features = load_features(tmp_path / "best" / FEATURES)
    assert features is not None and len(features[0]["a"].positions) == 3 and features[1] == recipes(True)[2]


def test_of_equal_models_the_one_with_more_points_and_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few, many = (model_of(row(3), grid_points(n)) for n in (30, 40))
    tries = Tries(monkeypatch, (few, FIVE), (many, FIVE), (few, FIVE), (many, FIVE))
    assert run(job(tmp_path), tries.say).message["points"] == 40
    kept = load_features(tmp_path / "best" / FEATURES)
    assert kept is not None and kept[1] == recipes(True)[1]


def test_a_trusted_model_ends_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = Tries(monkeypatch, (model_of(row(4), grid_points(30)), FIVE))
    assert run(job(tmp_path), tries.say).message["verdict"] == "trusted" and len(tries.said) == 1


def test_a_camera_that_only_turned_ends_it_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = Tries(monkeypatch, (None, replace(FIVE, rotating=0.9)))
    result = run(job(tmp_path), tries.say)
    assert result.kind == "failed" and result.message["kind"] == "DegenerateMotion"


def test_no_further_attempt_begins_after_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = Tries(monkeypatch, (None, FIVE))
    result = run(job(tmp_path, time_limit=-1.0), tries.say)
    assert result.kind == "failed" and result.message["kind"] == "CameraError"
    assert "5 photos (filtered: no model)" in result.message["what"]


def test_sharp_photos_have_four_recipes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = Tries(monkeypatch, *[(None, FIVE)] * 4)
    run(job(tmp_path, kernel=None), tries.say)
    assert [m["attempt"]["name"] for m in tries.said] == ["plain", "faint", "thorough", "relaxed"]


@pytest.mark.parametrize(("found", "many", "tried"), [((5,), 50, 1), ((4, 5), 50, 2), ((4, 4, 4), 50, 3), ((4,), 5, 1)])
def test_photos_without_a_place_are_looked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: tuple[int, ...], many: int, tried: int
) -> None:
    """By fainter and smaller features, in small sets; relaxed matches are for models that nobody trusts."""
    tries = Tries(monkeypatch, *[(model_of(row(count), grid_points(30)), FIVE) for count in found])
    result = run(job(tmp_path, kernel=None, many=many), tries.say)
    assert result.message["verdict"] == "trusted" and result.message["registered"] == max(found)
    assert [m["attempt"]["name"] for m in tries.said] == ["plain", "faint", "thorough"][:tried]


def test_one_photo_in_twenty_may_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for count, tried in ((19, 1), (18, 2)):
        twenty = replace(GOOD, images=20)
        tries = Tries(
            monkeypatch, (model_of(row(count), grid_points(30)), twenty), (model_of(row(20), grid_points(30)), twenty)
        )
        folder = tmp_path / str(count)
        folder.mkdir()
        run(job(folder, 20, kernel=None), tries.say)
        assert len(tries.said) == tried


def test_a_trusted_model_goes_before_one_of_more_photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, whole = model_of(row(4), grid_points(30)), model_of(row(5), grid_points(60))
    doubted = (whole, replace(FIVE, contradicted=0.06))
    tries = Tries(monkeypatch, (some, FIVE), doubted, doubted)
    assert run(job(tmp_path, kernel=None), tries.say).message["registered"] == 4


def test_a_model_that_pairs_contradict_is_doubted_but_better_than_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, doubted = model_of(row(5), grid_points(40)), replace(FIVE, contradicted=0.06)
    assert verdict(whole, doubted) == CONTRADICTED
    assert verdict(whole, replace(FIVE, contradicted=0.05)) == "trusted"
    tries = Tries(monkeypatch, (whole, replace(FIVE, contradicted=0.2)), (whole, doubted), (None, FIVE), (None, FIVE))
    result = run(job(tmp_path, kernel=None), tries.say)
    assert result.kind == "done" and len(tries.said) == 4
    assert (result.message["name"], result.message["contradicted"]) == ("faint", 0.06)


@pytest.mark.parametrize(("mapped", "joined"), [(20, True), (19, True), (18, False), (0, False)])
def test_key_photos_of_which_too_many_are_not_mapped_are_no_short_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mapped: int, joined: bool
) -> None:
    """One in twenty may be missing."""
    model = SimpleNamespace(num_reg_images=lambda: mapped)
    monkeypatch.setattr(attempts.keyframes, "read_matches", lambda database: None)
    monkeypatch.setattr(attempts.keyframes, "choose_keyframes", lambda matches, least: [str(i) for i in range(20)])
    monkeypatch.setattr(attempts.mapping, "map_incrementally", lambda *given: [model] if mapped else [])
    monkeypatch.setattr(attempts, "pixel_exact", lambda found, *given: found)
    monkeypatch.setattr(attempts.keyframes, "place_others", lambda found, *given: found)
    for many, short in ((40, joined), (41, False)):
        one = job(tmp_path, 40, many=many)
        found = attempts._by_keyframes(one, RECIPE, tmp_path, tmp_path, tmp_path, {}, lambda: None)
        assert found is (model if short else None)


def test_large_sets_are_looked_at_less_closely(tmp_path: Path) -> None:
    np.save(tmp_path / "0.npy", np.zeros((90, 121), np.uint16))
    x = np.arange(-15, 16)
    wide = [np.exp(-(x**2) / (2 * s**2)) / np.exp(-(x**2) / (2 * s**2)).sum() for s in (3.0, 5.0, 6.0)]
    few = {"many": 6, "many_sigma": 4.0}
    assert lighter(RECIPE, job(tmp_path, 5, **few)) is RECIPE
    blurred = lighter(RECIPE, job(tmp_path, 6, kernel=np.outer(wide[1], wide[2]), **few))
    assert (blurred.max_features, blurred.guided, blurred.image_size) == (600, False, 60)
    for kernel in (np.outer(wide[0], wide[2]), np.outer(wide[2], wide[0]), None):
        assert lighter(RECIPE, job(tmp_path, 6, kernel=kernel, **few)).image_size == 0
    assert lighter(PLAIN, job(tmp_path, 6, kernel=np.outer(wide[1], wide[1]), **few)).image_size == 0
    assert lighter(replace(RECIPE, max_features=70), job(tmp_path, 6, **few)).max_features == 70


def test_the_narrower_axis_of_a_kernel() -> None:
    kernel = np.zeros((3, 5))
    kernel[[0, 2], 2] = 0.5  # 1 px up and down, nothing sideways
    assert attempts._narrowest(kernel) == 0.0
    kernel[:] = 0.0
    kernel[np.ix_([0, 2], [0, 4])] = 0.25
    assert attempts._narrowest(kernel) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("connected", "given", "kind"),
    [(2, 4, "NoOverlap"), (3, 4, "CameraError"), (2, 2, "CameraError"), (4, 20, "NoOverlap"), (5, 20, "CameraError")],
)
def test_photos_that_are_not_tied_together(connected: int, given: int, kind: str) -> None:
    geometry = replace(GOOD, connected=connected)
    said = explain([replace(GOOD, connected=0), geometry], [Attempt("a", "b", verdict="no model")], given)
    assert said["kind"] == kind and "(a: no model)" in said["what"] and "--cameras" in said["way_out"]
    if kind == "NoOverlap":
        assert f"Only {connected} of {given} photos" in said["what"]


@pytest.mark.parametrize(
    ("change", "verdict", "kind"),
    [
        ({}, "rays too parallel", "DegenerateMotion"),
        ({"rotating": 0.81}, "no model", "DegenerateMotion"),
        ({"flat": 0.81}, "no model", "DegenerateMotion"),
        ({"flat": 0.8, "rotating": 0.8}, "no model", "CameraError"),
    ],
)
def test_a_flat_scene_and_a_turn_are_named(change: dict[str, float], verdict: str, kind: str) -> None:
    log = [Attempt("a", "b", verdict=verdict), Attempt("c", "d", verdict="too few points")]
    said = explain([replace(GOOD, **change)], log, 4)
    assert said["kind"] == kind and f"a: {verdict}, c: too few points" in said["what"]


def test_the_attempt_that_tied_the_most_photos_explains() -> None:
    flat = replace(GOOD, connected=4, verified=5, flat=1.0)
    assert explain([flat, replace(GOOD, verified=4), replace(GOOD, connected=3)], [], 4)["kind"] == "DegenerateMotion"
    assert explain([flat, GOOD], [], 4)["kind"] == "CameraError"


def test_an_attempt_travels_as_json() -> None:
    found = judge(model_of(row(4), grid_points(40)), GOOD, SfmSettings(), RECIPE)
    assert Attempt(**asdict(found)) == found
