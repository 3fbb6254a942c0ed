"""A run's settings, split by stage once; and a run without a limit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import CameraMotion
from dgs.core.machine import Machine
from dgs.core.pipeline.timing import NoteKeeper, Stopwatch, Untimed
from dgs.core.pipeline.training import UNTIL_STEPS, Shown, fit_into_time, training_settings, usual_settings
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from dgs.core.training.density.budget import SETTINGS as BUDGET
from dgs.core.training.job import TrainingJob
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin.folder import TwinFolder
from dgs.tests.core.training.training_scenes import blurred_scene

ONE = Machine(1, "cpu")


def test_what_report_json_keeps_gives_the_settings_again():
    asked = ReconstructSettings(Path("p"), Path("o"), psf="gaussian:2", masks=Path("m"), until=28.0, seed=3)
    assert ReconstructSettings.from_plain({**asked.plain(), "of another version": 1}) == asked
    assert asked.split().asked == asked.plain()


def test_every_setting_goes_to_a_stage():
    """Each field, changed alone, changes the split settings besides their record of what was asked."""
    plain = ReconstructSettings(Path("p"), Path("o"))
    other = {"psf": "auto", "blur_space": "linear", "frames": 7, "holdout_every": 3, "preset": "draft", "loss": "paper"}
    other |= {"photos": Path("q"), "out": Path("r"), "min_steps": 9, "seed": 4, "effects": "auto", "device": "cpu"}
    other |= {"background": "none", "glass": "0.4,1", "rolling_shutter": "1"}
    for name, value in plain.plain().items():
        new = other.get(name, (not value) if isinstance(value, bool) else Path("x") if value is None else None)
        changed = ReconstructSettings(**{**vars(plain), name: new}).split()
        assert {**vars(changed), "asked": None} != {**vars(plain.split()), "asked": None}, name


def test_motion_is_apart_from_the_blur_where_it_may_be_simulated():
    for effects, apart in (("none", False), ("auto", True), ("auto,-motion", False), ("haze", False), ("motion", True)):
        assert ReconstructSettings(Path("p"), Path("o"), effects=effects).split().medium.motion_apart is apart


def test_a_run_that_waits_for_a_quality_may_take_more_steps_unless_its_time_is_limited():
    request = ReconstructSettings(Path("p"), Path("o"), until=28.0, max_gaussians=700).split().training
    usual = usual_settings(request, ONE)
    assert training_settings(request, ONE, limited=True, shown=Shown(5.0)).steps == usual.steps
    free = training_settings(request, ONE, limited=False, shown=Shown(5.0))
    assert free.steps == UNTIL_STEPS * usual.steps and free.max_gaussians == 700 and free.until == 28.0


def test_a_budget_is_what_the_photos_can_hold_unless_it_is_asked_for(tmp_path):
    scene, timing = blurred_scene(4), Untimed(ONE, lambda: 0.0)
    found = {}
    for name in ("draft", "balanced", "best"):
        job = TrainingJob(scene.views, [], scene.points, scene.medium, TrainingSettings.preset(name))
        planned = fit_into_time(job, [], None, False, timing, TwinFolder(tmp_path))
        found[name] = planned.settings.max_gaussians
        assert fit_into_time(job, [], 1, False, timing, TwinFolder(tmp_path)).settings == job.settings
    usual = {name: TrainingSettings.preset(name).max_gaussians for name in ("draft", "balanced")}
    assert found == {**usual, "best": BUDGET.unquestioned}


def test_sharp_photos_get_all_harmonics_unless_a_degree_is_asked_for():
    request = ReconstructSettings(Path("p"), Path("o")).split().training
    degrees = [
        training_settings(request, ONE, limited=False, shown=Shown(sigma)).sh_degree for sigma in (0.0, 2.5, 2.6, 5.0)
    ]
    assert degrees == [3, 3, 1, 1]
    asked = ReconstructSettings(Path("p"), Path("o"), sh_degree=2).split().training
    assert training_settings(asked, ONE, limited=False, shown=Shown(0.0)).sh_degree == 2
    best = ReconstructSettings(Path("p"), Path("o"), preset="best").split().training
    assert training_settings(best, ONE, limited=False, shown=Shown(5.0)).sh_degree == 3


def test_an_untimed_run_asks_for_nothing():
    timing = Untimed(ONE, lambda: 1e9)
    assert not timing.limited and not timing.hurry([]) and timing.another() and timing.overrun() == 0.0
    assert timing.predicted([]) is None


def test_waiting_is_counted_and_laps_add_up():
    keeper, watch = NoteKeeper(Silent()), Stopwatch()
    keeper.note("one")
    assert keeper.notes == ["one"] and not keeper.cancelled() and keeper.waited >= 0.0
    watch.lap("prepare")
    watch.part("prepare", {"train": 5.0})
    assert watch.seconds == {"prepare": 0.0, "train": 5.0} and watch.total() >= 0.0


def test_photos_that_nothing_blurs_get_more_steps_and_gaussians_that_they_show_amply():
    def planned(
        sigma: float, formation: Formation | None, preset: str = "balanced", count: int = 60
    ) -> tuple[int, int]:
        request = ReconstructSettings(Path("p"), Path("o"), preset=preset).split().training
        wide = replace(blurred_scene(1).views[0], photo=np.zeros((400, 600, 3), np.uint8))
        found = training_settings(request, ONE, limited=False, shown=Shown(sigma, formation, count * [wide]))
        return found.steps, found.max_gaussians

    still, moving = Formation(), Formation((CameraMotion(("a",), torch.zeros(1, 5, 6)),))
    assert planned(0.0, still) == (1500, 120000) and planned(0.0, moving) == (1500, 48990)
    amply = int(3 * 20 * 400 * 600 / (BUDGET.ample * 59))
    assert planned(0.0, still, count=20) == (1500, amply) and 49_000 < amply < 80_000
    assert planned(0.0, still, count=5) == (1500, 48990)
    assert planned(0.0, None) == planned(5.0, still) == (1000, 40000)
    assert planned(0.0, still, "best") == planned(0.0, None, "best"), "ends by evidence anyway"
