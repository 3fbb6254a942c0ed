"""How far a run is and when it ends, and what an interrupted one leaves."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from dgs.core.progress import Silent
from dgs.core.training.job import TrainingJob
from dgs.core.training.run import Trained, train
from dgs.core.training.schedule import SCHEDULE, Schedule, harmonics_degree
from dgs.core.training.settings import TrainingSettings
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, Scene, blurred_scene, same

SETTINGS = TrainingSettings(steps=100)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return blurred_scene(6)


class StopsAfter(Silent):
    """The user stops at the n-th step."""

    def __init__(self, steps: int) -> None:
        self.steps = steps

    def cancelled(self) -> bool:
        self.steps -= 1
        return self.steps < 0


def run(scene: Scene, settings: TrainingSettings = SHORT, progress: Silent = Silent(), **options) -> Trained:
    job = TrainingJob(scene.views[1:], scene.views[:1], scene.points, scene.medium, settings)
    return train(job, progress, **options)


def ends(schedule: Schedule, seconds_per_step: float, most: int = 100_000) -> tuple[int, str, list[float]]:
    """Step at which a run at this pace ends, why, and its shares."""
    shares = []
    for step in range(most):
        spent = step * seconds_per_step
        ending = schedule.ended(step, spent)
        if ending is not None:
            return step, ending, shares
        shares.append(schedule.share(step, spent))
    raise AssertionError("it never ends")


def test_harmonics_grow_degree_by_degree():
    shares = [i / 1000 for i in range(1000)]
    for highest in (0, 1):
        assert {harmonics_degree(share, highest) for share in shares} == {highest}, "as ever"
    for highest in (2, 3):
        degrees = [harmonics_degree(share, highest) for share in shares]
        assert degrees == sorted(degrees) and set(degrees) == set(range(1, highest + 1))
        assert degrees[int(1000 * SCHEDULE.harmonics_until)] == highest


def test_harmonics_that_are_not_due_stay_nothing(scene: Scene):
    settings = replace(SHORT, sh_degree=3, coarse_share=0.0)
    trainer = Trainer(scene.views, [], scene.points, scene.medium, settings)
    for share, learned in ((0.0, 4), (0.6 * SCHEDULE.harmonics_until, 9), (SCHEDULE.harmonics_until, 16)):
        trainer.advance(share)
        sh = trainer.optimizer.gaussians.sh.detach()
        assert (sh[:, :learned] != 0).any(dim=2).any(dim=0).all(), "what is due is learned"
        assert (sh[:, learned:] == 0).all()


def test_steps_are_the_plan_without_a_limit():
    step, ending, shares = ends(Schedule(SETTINGS, None), 1.0)
    assert (step, ending) == (100, "done")
    assert shares == pytest.approx([i / 100 for i in range(100)])


@pytest.mark.parametrize("pace", [0.01, 0.1, 1.0])
def test_time_is_the_plan_with_one_whatever_the_pace(pace):
    step, ending, shares = ends(Schedule(SETTINGS, 10.0), pace)
    assert ending == "time limit" and step == pytest.approx(10.0 / pace, abs=1)
    assert shares[0] == 0.0 and shares[len(shares) // 2] == pytest.approx(0.5, abs=0.06)
    assert shares[-1] == pytest.approx(1.0, abs=1.1 * pace / 10)


def test_a_resumed_run_goes_on_where_it_was():
    assert Schedule(SETTINGS, 10.0, step=40).share(40, 0.0) == pytest.approx(0.4)
    assert Schedule(SETTINGS, 10.0, step=40).share(60, 5.0) == pytest.approx(0.7)


def test_steps_that_are_asked_for_are_taken_though_time_is_up():
    schedule = Schedule(replace(SETTINGS, min_steps=50), 10.0)
    step, ending, shares = ends(schedule, 1.0)
    assert (step, ending) == (50, "time limit")
    assert shares[-1] == pytest.approx(0.98, abs=0.02), "the whole course fits into the longer run"


def test_a_plateau_cools_down_and_ends():
    schedule = Schedule(replace(SETTINGS, steps=1000, until="plateau"), None)
    shares, ending, step = [], None, 0
    while ending is None:
        shares.append(schedule.share(step, 0.0))
        step += 1
        if step % 25 == 0:
            schedule.evaluated(step, 0.0, 20.0 + min(step, 500) / 100)
        ending = schedule.ended(step, 0.0)
    assert ending == "plateau" and 500 < step < 1000
    assert shares[-1] > 0.98, "the step sizes came down all the way"
    began = next(i for i in range(1, len(shares)) if shares[i] - shares[i - 1] > 0.0011)
    assert step - began == pytest.approx(SCHEDULE.cooling * began, rel=0.2)


def test_while_it_rises_there_is_no_plateau():
    schedule = Schedule(replace(SETTINGS, steps=1000, until="plateau"), None)
    for step in range(25, 1000, 25):
        schedule.evaluated(step, 0.0, 20.0 + step / 100)
        assert schedule.share(step, 0.0) == pytest.approx(step / 1000)
    assert schedule.ended(1000, 0.0) == "done"


def test_a_score_before_any_work_is_no_plateau():
    schedule = Schedule(replace(SETTINGS, until="plateau"), 10.0)
    schedule.evaluated(0, 0.0, 20.0)
    assert schedule.share(0, 0.0) == 0.0 and schedule.ended(0, 0.0) is None


def test_scores_that_swing_are_no_plateau_while_the_best_of_them_rise():
    """As they do where Gaussians come and go: by a dB up and down, and 0.8 dB better in the end."""
    schedule = Schedule(replace(SETTINGS, steps=1000, until="plateau"), None)
    for i, step in enumerate(range(25, 1000, 25)):
        schedule.evaluated(step, 0.0, 20.0 + step / 1000 + (i % 3 - 1.0))
        assert schedule.share(step, 0.0) == pytest.approx(step / 1000)


def test_a_quality_ends_the_run_but_not_before_its_least_steps():
    schedule = Schedule(replace(SETTINGS, until=25.0, min_steps=60), None)
    schedule.evaluated(40, 0.0, 24.9)
    assert schedule.ended(61, 0.0) is None
    schedule.evaluated(50, 0.0, 25.0)
    assert schedule.ended(59, 0.0) is None and schedule.ended(60, 0.0) == "quality"


def test_a_run_that_is_good_enough_ends(scene: Scene):
    trained = run(scene, replace(SHORT, steps=400, until=15.0))
    assert trained.stopped == "quality" and trained.steps < 400
    assert trained.history[-1]["heldout_psnr"] >= 15.0


def test_the_limit_shapes_the_run(scene: Scene):
    """Step sizes have come down when the time is up, though far fewer steps fitted than were expected."""
    seen = []
    began = time.perf_counter()
    trained = run(scene, replace(SHORT, steps=1_000_000, time_limit=3.0), watch=lambda t: seen.append(t.step))
    assert trained.stopped == "time limit" and time.perf_counter() - began < 3.0 + 3.0
    assert seen == list(range(1, trained.steps + 1))
    evaluated = [row["seconds"] for row in trained.history]
    assert evaluated == sorted(evaluated) and len(evaluated) >= 3


def test_a_stopped_run_leaves_its_best(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    """Held-out accuracy that fell before the user stopped: the twin of the best evaluation comes out."""
    from dgs.core.training import run as module

    kept = {}

    def evaluation(trainer, loss, seconds):
        kept[trainer.step] = trainer.result()
        psnr = 30.0 if trainer.step < 12 else 20.0
        return {"step": trainer.step, "seconds": seconds, "loss": loss, "gaussians": 1, "heldout_psnr": psnr}

    monkeypatch.setattr(module, "_evaluation", evaluation)
    stopped = run(scene, progress=StopsAfter(23))
    assert stopped.stopped == "cancelled"
    assert same(stopped.gaussians, kept[min(kept)])
    assert not same(stopped.gaussians, kept[max(kept)])
    assert same(run(scene).gaussians, kept[SHORT.steps]), "a run that was not stopped leaves its last state"
