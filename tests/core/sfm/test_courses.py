"""Several courses through the same matches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from dgs.core.sfm import courses, mapping
from dgs.core.sfm.contradictions import Agreement
from dgs.core.sfm.job import SfmJob
from dgs.core.sfm.settings import PLAIN, RELAXED, Recipe, SfmSettings

from .models import grid_points, model_of
from .test_contradictions import CENTRES, POINTS, database, model


def job(folder: Path, count: int = 4, many: int = 50) -> SfmJob:
    images = {f"0/{i:04d}.png": folder / f"{i}.npy" for i in range(1, count + 1)}
    return SfmJob(folder, images, {}, False, None, SfmSettings(many=many))


class Mapper:
    """Gives models that were made beforehand, one for each course."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *models: Any) -> None:
        self.models, self.asked = models, []
        monkeypatch.setattr(mapping, "map_incrementally", self.one)

    def one(self, job: SfmJob, recipe: Recipe, database: Path, images: Path, output: Path, joined: Any) -> list[Any]:
        self.asked.append(recipe)
        found = self.models[min(len(self.asked), len(self.models)) - 1]
        return [] if found is None else [found]


def best(folder: Path, given: SfmJob, database: Path, recipe: Recipe = PLAIN) -> Any:
    return courses.best(given, recipe, database, folder, folder / "models", 0.05, lambda: None)


def test_a_model_of_all_photos_that_pairs_agree_with_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper(monkeypatch, model())
    assert best(tmp_path, job(tmp_path), database(tmp_path)) is mapper.models[0]
    assert mapper.asked == [PLAIN]


def test_the_course_that_explains_most_matches_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a model, one with a wrong camera, the right one, and one of two photos."""
    mapper = Mapper(monkeypatch, model_of(CENTRES[:3], POINTS), model(turned=3), model(), model_of(CENTRES[:2], POINTS))
    assert best(tmp_path, job(tmp_path), database(tmp_path)) is mapper.models[2]
    assert [(r.init_inliers, r.pose_inliers, r.pose_ratio, r.seed) for r in mapper.asked] == [
        (100, 30, 0.25, 0),
        (100, 15, 0.25, 0),
        (40, 15, 0.15, 0),
        (40, 15, 0.15, 1),
        (40, 15, 0.15, 2),
    ]


def test_a_whole_model_that_pairs_contradict_is_not_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper(monkeypatch, model(turned=3), model())
    assert best(tmp_path, job(tmp_path), database(tmp_path)) is mapper.models[1]


def test_where_all_explain_alike_the_recipes_own_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper(monkeypatch, model_of(CENTRES[:3], POINTS), model_of(CENTRES[:3], POINTS))
    assert best(tmp_path, job(tmp_path), database(tmp_path)) is mapper.models[0]


def test_no_course_leads_to_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper(monkeypatch, None)
    assert best(tmp_path, job(tmp_path), database(tmp_path)) is None and len(mapper.asked) == 5


def test_no_course_is_taken_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mapper = Mapper(monkeypatch, None)
    best(tmp_path, job(tmp_path), database(tmp_path), RELAXED)
    assert [(r.pose_inliers, r.seed) for r in mapper.asked] == [(15, 0), (10, 0), (10, 1), (10, 2)]


def test_large_sets_try_one_other_course(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes them long."""
    mapper = Mapper(monkeypatch, None)
    assert best(tmp_path, job(tmp_path, many=4), database(tmp_path)) is None and len(mapper.asked) == 2


def test_courses_ask_for_no_more_than_their_recipe() -> None:
    eager = replace(RELAXED, pose_inliers=9, pose_ratio=0.1, init_inliers=20)
    assert {(r.pose_inliers, r.pose_ratio, r.init_inliers) for r in [*courses.lenient(eager)][1:]} == {(9, 0.1, 20)}


def test_a_photo_joins_by_as_many_matches_as_make_a_pair() -> None:
    assert {r.pose_inliers for r in courses.lenient(replace(PLAIN, min_inliers=11))} == {11}


def test_the_measure_that_courses_are_chosen_by(tmp_path: Path) -> None:
    """A camera that only a few points show, apart from all others, explains none of their pairs."""
    alone = model_of(CENTRES[:1], grid_points(20))
    assert courses.agreement(database(tmp_path), alone) == Agreement(0.0, 0.0)
