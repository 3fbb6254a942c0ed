"""Records, laws, probe and plan: what is predicted before a run, and that a plan fits its time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core.effort import plan
from dgs.core.effort.described import RunDescription
from dgs.core.effort.model import LAWS, PREDICTIONS, accuracy, contrast, memory, slowdown, stage_seconds
from dgs.core.effort.plan import PLANNING, Budget, gaussians_for, longest_steps, steps_within, useful_steps
from dgs.core.effort.probe import Phase, Speed, made_up, probe
from dgs.core.effort.records import RECORDS, PastRun, Records, Work
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.photos.load import Photo
from dgs.core.run_settings import ReconstructSettings
from dgs.core.training.job import PlannedTraining, TrainingJob
from dgs.core.training.settings import TrainingSettings, preset_for_sharp

WORK = Work(40, 16.0, 0.4, 35, 5, 1000, 40_000, True, False, True, True)
MACHINE = {"processor": "one", "cores": 2, "threads": 2, "device": "cpu"}
SPEED = Speed((Phase(0.12, 0.002, 1e-7), Phase(0.88, 0.01, 4e-7)), 4, 1.0)


def run_of(factor: float = 1.0, **changes) -> PastRun:
    """A past run that took `factor` times what the laws say."""
    seconds = {stage: factor * law(WORK) for stage, law in LAWS.items()} | {"train": factor * 20.0}
    plain = PastRun(WORK, seconds, 20.0, 1000.0, "scene", "balanced", 0.1, 30.0, None, 0.0)
    return replace(plain, **changes)


def described(**changes) -> RunDescription:
    """A usual run that finds its cameras."""
    usual = RunDescription.of(ReconstructSettings(Path("p"), Path("o")).split())
    return replace(usual, **changes)


def photo(name: str, width: int = 96, height: int = 80, amplitude: float = 0.2) -> Photo:
    noise = np.random.default_rng(len(name)).normal(size=(height, width, 3))
    pixels = (255 * np.clip(0.5 + amplitude * noise, 0, 1)).astype(np.uint8)
    return Photo(name, Path(name), pixels)


def test_records_come_back_and_belong_to_one_machine(tmp_path: Path):
    records = Records(MACHINE, tmp_path)
    records.add(run_of())
    records.predict("job", {"seconds": 3.0})
    again = Records(MACHINE, tmp_path)
    assert again.runs == [run_of()] and again.predictions == {"job": {"seconds": 3.0}}
    assert Records({**MACHINE, "processor": "another"}, tmp_path).runs == []
    for index in range(RECORDS.kept + 5):
        again.predictions[str(index)] = {}
    again.predict("last", {})
    assert len(Records(MACHINE, tmp_path).predictions) == RECORDS.kept


def test_a_damaged_cache_is_no_cache(tmp_path: Path):
    Records(MACHINE, tmp_path).add(run_of())
    (file,) = tmp_path.iterdir()
    whole = file.read_text("utf-8")
    for text in ("", "[]", whole[: len(whole) // 2], whole.replace('"steps"', '"paces"')):
        file.write_text(text, "utf-8")
        assert Records(MACHINE, tmp_path).runs == []


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path: Path):
    (tmp_path / "cache").write_text("a file in its place")
    Records(MACHINE, tmp_path / "cache").add(run_of())
    assert (tmp_path / "cache").read_text() == "a file in its place"


def test_runs_of_this_machine_set_the_laws_right():
    _, blind = stage_seconds([], WORK, 20.0)
    stages, known = stage_seconds([run_of(3.0)] * 6, WORK, 20.0)
    assert not blind.calibrated and known.calibrated
    assert known.value == pytest.approx(3.0 * blind.value, rel=1e-6)
    assert stages["train"] == pytest.approx(60.0)
    assert known.high - known.low < 0.3 * (blind.high - blind.low) * 3.0
    assert known.low < known.value < known.high


def test_disturbed_runs_count_only_where_there_is_no_other():
    mixed = [run_of(1.0, disturbed=0.02), *[run_of(9.0, disturbed=0.8)] * 5]
    assert stage_seconds(mixed, WORK, 20.0)[0]["train"] == pytest.approx(20.0)
    assert stage_seconds(mixed[1:], WORK, 20.0)[0]["train"] == pytest.approx(180.0)


def test_points_from_nothing_take_longer_than_surfaces_around_points():
    around, whole = (
        stage_seconds([], replace(WORK, search=False, points=p), 20.0)[0]["surface"] for p in (True, False)
    )
    assert 0 < around < 6 and whole > 2 * around
    # Past runs of the one kind say nothing of the other.
    slow = [run_of(3.0)] * 6
    assert stage_seconds(slow, WORK, 20.0)[0]["surface"] == pytest.approx(3 * around)
    assert stage_seconds(slow, replace(WORK, points=False), 20.0)[0]["surface"] == pytest.approx(whole)


def test_trials_of_effects_are_counted_and_set_right_by_their_own_runs():
    plain, whole = stage_seconds([], WORK, 20.0)
    tried, more = stage_seconds([], WORK, 20.0, trials=True)
    assert "trials" not in plain and "effects" not in tried
    assert more.value - whole.value == pytest.approx(LAWS["trials"](WORK) - LAWS["effects"](WORK))
    past = run_of(seconds={"trials": 3 * LAWS["trials"](WORK)}, train_predicted=None, memory_mb=None)
    again, _ = stage_seconds([past], WORK, 20.0, trials=True)
    assert again["trials"] == pytest.approx(3 * tried["trials"]) and again["train"] == tried["train"]
    assert described(trials=True).job_key("scene", "fine") != described().job_key("scene", "fine")


def test_points_from_nothing_are_hurried_where_time_is_short():
    photos = [photo(f"{i}.png") for i in range(30)]
    given = described(search=False, points=False)
    assert Budget(20.0, lambda: 0.0, [], run=given).hurry(photos)
    assert not Budget(200.0, lambda: 0.0, [], run=given).hurry(photos)
    assert not Budget(20.0, lambda: 0.0, [], run=replace(given, points=True)).hurry(photos)


def test_a_busy_machine_is_slower_but_the_probe_has_felt_that():
    idle, busy = (stage_seconds([], WORK, 20.0, slowdown(share))[0] for share in (0.0, 0.5))
    assert busy["sfm"] == pytest.approx(2 * idle["sfm"]) and busy["train"] == idle["train"]
    assert slowdown(None) == slowdown(0.1) == 1.0


def test_memory_grows_with_photos_and_gaussians_and_learns():
    plain = memory([], WORK).value
    assert memory([], replace(WORK, gaussians=400_000)).value > plain + 300
    assert memory([], replace(WORK, photos=400)).value > 2 * plain
    assert memory([run_of(memory_mb=2 * plain)] * 4, WORK).value == pytest.approx(2 * plain)


def test_accuracy_is_predicted_only_once_it_is_calibrated():
    def scene(index: int, contrasty: float) -> PastRun:
        # the same relative error everywhere: more contrast, more error
        return run_of(scene=str(index), contrast=contrasty, psnr=28.0 - 20 * math.log10(contrasty / 0.1))

    runs = [scene(i, 0.05 * (i + 1)) for i in range(PREDICTIONS.scenes)]
    assert accuracy(runs[:-1], "balanced", "new", 0.1) is None
    assert accuracy(runs, "draft", "new", 0.1) is None, "another preset says nothing"
    predicted = accuracy(runs, "balanced", "new", 0.4)
    assert predicted is not None and predicted.value == pytest.approx(28.0 - 20 * math.log10(4), abs=1e-6)
    noisy = accuracy([*runs, run_of(scene="odd", psnr=33.0)], "balanced", "new", 0.4)
    assert noisy is not None and noisy.high - noisy.low > 2.0
    own = accuracy([run_of(scene="new", psnr=31.0)], "balanced", "new", 0.4)
    assert own is not None and own.value == 31.0


def test_contrast_is_that_of_the_photos():
    assert contrast([photo("a", amplitude=0.2)]) > 1.8 * contrast([photo("a", amplitude=0.1)])
    assert contrast([photo("a", 8, 8)]) > 0, "photos smaller than a block"


def test_gaussians_grow_as_the_presets_do():
    for name in ("balanced", "fine", "best"):
        preset = TrainingSettings.preset(name)
        assert gaussians_for(preset.steps) == pytest.approx(preset.max_gaussians, rel=0.02)


def test_sharp_photos_get_as_many_as_they_show_amply_and_as_their_presets_have():
    sharp = preset_for_sharp(TrainingSettings.preset("balanced"), 10**6)
    assert gaussians_for(sharp.steps, 10**6) == pytest.approx(sharp.max_gaussians, rel=1e-4)
    assert gaussians_for(1500, 60_000) == 60_000 and gaussians_for(1500, 30_000) == gaussians_for(1500)
    poor, rich = (steps_within(SPEED, 60.0, None, ample) for ample in (0, 100_000))
    assert rich[0] < poor[0] and rich[1] > poor[1] and SPEED.training(*rich) == pytest.approx(60.0, rel=0.03)


@pytest.mark.parametrize("seconds", [1.0, 10.0, 300.0])
@pytest.mark.parametrize("fixed", [None, 30_000])
def test_steps_fill_the_time(seconds: float, fixed: int | None):
    steps, count = steps_within(SPEED, seconds, fixed)
    assert SPEED.training(steps, count) == pytest.approx(seconds, rel=0.03, abs=0.05)
    assert fixed is None or count == fixed


def test_a_probe_measures_what_iterations_cost():
    photos = [photo(f"{i}.png") for i in range(3)]
    views, points = made_up(photos)
    settings = TrainingSettings(threads=1)
    began = time.perf_counter()
    job = TrainingJob(views, [], points, Medium(PointSpread("gaussian", 2.0, 2.0)), settings, Formation())
    speed = probe(job, 3, 1, (300, 1500))
    assert speed.seconds <= time.perf_counter() - began
    assert sum(phase.share for phase in speed.phases) == pytest.approx(1.0)
    assert len(speed.phases) >= 2, "photos sharpened beforehand, then the photos themselves"
    assert all(phase.seconds(1000) > 0 for phase in speed.phases)
    assert speed.training(200, 1000) > speed.training(100, 1000) > 0


def since(began: float) -> Callable[[], float]:
    return lambda: time.perf_counter() - began


def planned(limit: float, spent: float = 0.0, held: int = 9, **changes) -> tuple[Budget, TrainingSettings]:
    photos = [photo(f"{i}.png") for i in range(4)]
    views, points = made_up(photos)
    budget = Budget(limit, since(time.perf_counter() - spent), [])
    settings = replace(TrainingSettings(threads=1), **changes)
    medium = Medium(PointSpread("gaussian", 2.0, 2.0))
    found = budget.train(TrainingJob(views, views[:1] * held, points, medium, settings, Formation()), photos, 600)
    assert budget.plan is not None and found.plan == budget.plan.plain() and found.enough == budget.plan.enough
    return budget, found.settings


def test_no_more_than_the_longest_training_is_planned():
    budget, settings = planned(3000.0)
    assert budget.plan is not None and settings.time_limit is not None
    assert budget.plan.enough and budget.plan.steps == settings.steps == longest_steps(4) == PLANNING.useful_steps
    assert settings.time_limit < 2900.0
    asked = longest_steps(4) + 500
    assert planned(3000.0, min_steps=asked)[1].steps == asked, "steps that are asked for are done"
    budget, settings = planned(3000.0, until=30.0)
    assert budget.plan is not None and not budget.plan.enough and settings.steps > longest_steps(4)
    assert longest_steps(42) == 42 * PLANNING.longest_visits, "few photos are learned sooner"
    assert longest_steps(200) == PLANNING.longest_steps
    assert longest_steps(1000) == useful_steps(1000) == 1000 * PLANNING.useful_visits, "many photos want more"


def test_held_out_photos_end_what_goes_beyond_the_useful(monkeypatch: pytest.MonkeyPatch):
    assert planned(3000.0)[1].until == "plateau"
    assert planned(3000.0, until=30.0)[1].until == 30.0, "who asks for a quality gets it"
    monkeypatch.setattr(plan, "PLANNING", replace(PLANNING, useful_steps=10**6, longest_steps=10**7))
    assert planned(60.0)[1].until is None


def test_what_is_left_goes_to_the_training(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(plan, "PLANNING", replace(PLANNING, useful_steps=10**6))
    budget, settings = planned(60.0, spent=20.0)
    assert budget.plan is not None and settings.time_limit is not None
    assert settings.time_limit + budget.plan.save_seconds == pytest.approx(budget.left(), abs=2.5)
    assert settings.steps == budget.plan.steps > 10 and settings.max_gaussians == 600
    late, settings = planned(10.0, spent=30.0)
    assert settings.time_limit == pytest.approx(1.0), "the training gets a share even so"
    assert late.left() < 0


def test_trials_get_a_share_of_what_the_cameras_leave():
    spent = [20.0]
    left = Budget(120.0, lambda: spent[0], []).for_trials()
    assert left() == pytest.approx(100.0 * PLANNING.trial_share)
    spent[0] = 50.0
    assert left() == pytest.approx(100.0 * PLANNING.trial_share - 30.0)
    spent[0] = 130.0
    assert Budget(120.0, lambda: spent[0], []).for_trials()() == 0.0


def test_waiting_does_not_count():
    waited, worked = [0.0], since(time.perf_counter() - 6.0)
    budget = Budget(10.0, lambda: worked() - waited[0], [])
    before = budget.left()
    waited[0] = 5.0
    assert budget.left() == pytest.approx(before + 5.0, abs=0.1)


def test_views_are_scored_while_there_is_time():
    late = Budget(10.0, since(time.perf_counter() - 60.0), [])
    assert [late.another() for _ in range(4)] == [True] * PLANNING.scored + [False] * 2
    early = Budget(1000.0, since(time.perf_counter()), [])
    assert all(early.another() for _ in range(20))


def test_a_resumed_plan_keeps_grid_and_gaussians():
    photos = [photo(f"{i}.png") for i in range(4)]
    views, points = made_up(photos)
    medium = Medium(PointSpread("gaussian", 2.0, 2.0))
    job = TrainingJob(views, views[:1], points, medium, TrainingSettings(threads=1), Formation())

    def planned_again(earlier: Mapping[str, Any] | None, fixed: int | None) -> PlannedTraining:
        return Budget(40.0, since(time.perf_counter()), []).train(job, photos, fixed, earlier)

    first = planned_again(None, 700)
    assert first.plan is not None
    assert planned_again(first.plan, None).settings.max_gaussians == first.settings.max_gaussians == 700
    assert planned_again({**first.plan, "grid_step": 2}, None).settings.grid_step == 2
    assert planned_again({}, 900).settings.max_gaussians == 900, "the plan is gone"
