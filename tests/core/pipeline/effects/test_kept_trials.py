"""Trials within the time that a run has, and what they said, kept for a run that is resumed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.core.errors import OutputError
from dgs.core.formats.colmap import write_model
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.photos.undistort import undistorted_views
from dgs.core.photos.write import write_png
from dgs.core.pipeline.effects import choose
from dgs.core.pipeline.effects.ablation import Ablation, Arm, TrialCourse, TrialTerms
from dgs.core.pipeline.effects.choose import choose_effects
from dgs.core.pipeline.effects.comparison import SETTINGS as TRIALS
from dgs.core.pipeline.effects.comparison import Comparison
from dgs.core.pipeline.effects.kept import KeptTrials
from dgs.core.pipeline.reconstruct import reconstruct
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from dgs.core.training import settings
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin.folder import TwinFolder
from dgs.tests.core.surface.scenes import arc, drawn

SETTINGS = TrainingSettings(steps=700, max_gaussians=20000, sh_degree=0, threads=1)
SHORT = replace(SETTINGS, steps=20, max_gaussians=1500)


class Time:
    """Seconds that are left: plenty for so many trainings, and none in the next one."""

    def __init__(self, trainings: float, then: float = math.inf) -> None:
        self.trainings, self.then = trainings, then
        self.begun = self.ended = 0

    def __call__(self) -> float:
        if self.begun > self.trainings:
            return 0.0
        return self.then if self.ended >= self.trainings else math.inf


@pytest.fixture(scope="module")
def dim():
    """Photos whose exposures and corners differ."""
    scene = make_scene(3, width=192, height=128, views=12, finer=2)
    return validation.photo_set(scene, degrade(scene, Truth(exposure=0.2, vignetting=0.3), seed=1))


@pytest.fixture
def views(dim):
    return undistorted_views(list(dim.photos), dim.cameras)


@pytest.fixture
def counted(monkeypatch):
    """Trainings that were begun; each takes one of those that `Time` has."""
    begun, of_pair = [], Ablation._of_pair

    def count(self, views, formation, medium, pair):
        begun.append((pair, formation.names))
        time = self._terms.left if isinstance(self._terms.left, Time) else Time(math.inf)
        time.begun += 1
        scores = of_pair(self, views, formation, medium, pair)
        time.ended += 1
        return scores

    monkeypatch.setattr(Ablation, "_of_pair", count)
    return begun


@pytest.mark.parametrize(
    ("time", "trainings", "judged"),
    [
        (Time(math.inf), 4, 6),
        (Time(0), 1, 0),  # the first is cut off
        (Time(1), 2, 0),  # a pair is not whole
        (Time(2), 3, 3),  # the second pair is cut off: the first decides
        (Time(2, then=1e-6), 2, 3),  # too little for the second pair, which is not begun
    ],
)
def test_trials_end_with_their_time(dim, views, counted, time, trainings, judged):
    trial = Ablation(views, dim.cameras.points, Medium(), TrialTerms(SHORT, time))
    exposure = choose.built("exposure", dim)
    found = trial.compare(Arm(), Arm(Formation([exposure])))
    assert len(counted) == trainings and len(found.differences) == judged
    assert found.made is (judged > 0)
    assert found.made or "time limit" in found.seen


def test_a_longer_trial_is_begun_only_where_it_will_end(dim, views, monkeypatch):
    moved = Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    doubtful = np.array([0.5, 0.0] * 3)

    def scores(self, arm, medium, pair):
        steps.append(self.settings.steps)
        return 30.0 + (doubtful if arm.formation.names else 0.0 * doubtful)

    monkeypatch.setattr(Ablation, "_scores", scores)
    monkeypatch.setattr("dgs.core.pipeline.effects.ablation.time.perf_counter", lambda: float(len(steps)))
    for left, longer in ((2.1 * TRIALS.longer_takes, True), (1.9 * TRIALS.longer_takes, False)):
        steps: list[int] = []
        trial = Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS, lambda left=left: left))
        trial._cut(TRIALS.path_steps, TRIALS.path_gaussians)
        found = trial._compare_paths(Arm(), moved)
        assert (TRIALS.longer * TRIALS.path_steps in steps) is longer and not found.confirms and found.made


def test_a_trial_says_how_far_it_is(dim, views, monkeypatch):
    """In hundredths of a trial, never backwards: a bar that stands for minutes looks like a run that hangs."""
    heard = []
    moved = Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)])
    trial = Ablation(views, dim.cameras.points, Medium(), TrialTerms(replace(SHORT, steps=60)))
    trial.course = TrialCourse(heard.append)
    monkeypatch.setattr(Comparison, "contradicts", False)
    monkeypatch.setattr(Comparison, "settled", False)
    monkeypatch.setattr(Comparison, "surely_more", False)
    monkeypatch.setattr(
        "dgs.core.pipeline.effects.ablation.SETTINGS", replace(TRIALS, path_steps=20, path_gaussians=300, path_seen=0.0)
    )
    trial.compare(Arm(), Arm(moved))
    assert heard == sorted(heard) and 0 < heard[0] < 0.1 and 0.85 < heard[-1] <= 0.99
    assert len({round(share, 2) for share in heard}) > 20


def test_what_cannot_be_tried_in_time_is_simulated_only_beyond_doubt(dim, views, monkeypatch):
    found = choose.inspect_photos(dim, Silent(), {"exposure"})
    monkeypatch.setattr(choose, "inspect_photos", lambda *asked: found)
    terms = TrialTerms(SHORT, lambda: 0.0)
    for certain in (frozenset({"exposure"}), frozenset()):
        monkeypatch.setattr(choose, "_certain", lambda *asked, certain=certain: certain)
        decided = choose_effects("auto", dim.photos, dim.cameras, views, Medium(), terms, Silent()).decisions
        line = next(decision for decision in decided if decision.name == "exposure")
        assert line.on is bool(certain) and "the time limit leaves no time to try it" in line.why


def test_what_trials_said_comes_back_only_where_it_was_asked_for(tmp_path):
    folder = TwinFolder(tmp_path)
    said = {
        "a": Comparison(np.array([0.25, -1.0]), "", 0.3, "; two trainings find the same paths"),
        "b": Comparison(np.zeros(3), "a round blur", math.inf),
        "c": Comparison.not_made("no time"),
    }
    kept = KeptTrials(folder)
    for name, one in said.items():
        kept.put(name, one)
    again = KeptTrials(folder, resume=True)
    for name, one in said.items():
        found = again.get(name)
        assert found.differences.tolist() == one.differences.tolist() and found.made is one.made
        assert (found.seen, found.beside) == (one.seen, one.beside)
        assert found.least == one.least
    assert again.get("d") is None and KeptTrials(folder).get("a") is None
    KeptTrials(folder).put("e", said["a"])
    assert KeptTrials(folder, resume=True).get("a") is None, "a new run begins anew"
    for damage in ("[]", "{", '{"x": {"differences": ["y"], "seen": "", "least": 0.0}}'):
        (tmp_path / "trials.json").write_text(damage)
        assert folder.trials() == {}
    KeptTrials().put("a", said["a"])
    with pytest.raises(OutputError):
        KeptTrials(TwinFolder(tmp_path / "trials.json")).put("a", said["a"])


def test_another_run_s_trials_are_not_believed(dim, views, counted, tmp_path):
    exposure = Arm(Formation([choose.built("exposure", dim)]))

    def compared(settings, photos, medium=Medium(), resume=True):
        kept = KeptTrials(TwinFolder(tmp_path), resume)
        found = Ablation(photos, dim.cameras.points, medium, TrialTerms(settings, kept=kept)).compare(Arm(), exposure)
        trained, counted[:] = len(counted), []
        return found.differences.tolist(), trained

    first, trained = compared(SHORT, views, resume=False)
    assert trained == 4 and compared(replace(SHORT, threads=2), views) == (first, 0)
    assert compared(replace(SHORT, seed=5), views)[1] == 4
    assert compared(SHORT, views[:-1])[1] == 4
    assert compared(SHORT, views) == (first, 0), "all are kept beside each other"


def test_a_run_that_is_resumed_tries_nothing_again(tmp_path, counted, monkeypatch):
    monkeypatch.setattr(settings, "PRESETS", replace(settings.PRESETS, draft_steps=40))
    scene = drawn(arc(12), (96, 72))
    (tmp_path / "photos").mkdir()
    for index, photo in enumerate(scene.photos):
        dimmed = np.round(photo.pixels * (0.6 + 0.4 * (index % 2))).astype(np.uint8)
        write_png(tmp_path / "photos" / photo.name, dimmed)
    write_model(tmp_path / "model", scene.cameras.cameras(), scene.cameras.points)
    asked = ReconstructSettings(
        tmp_path / "photos",
        tmp_path / "twin",
        cameras=tmp_path / "model",
        preset="draft",
        effects="auto",
        max_gaussians=900,
        holdout_every=6,
        threads=1,
    )
    first = reconstruct(asked.split(), Silent()).report
    assert counted, "nothing was tried"
    counted.clear()
    again = reconstruct(replace(asked, resume=True).split(), Silent()).report
    assert not counted
    decided = lambda report: [(e["name"], e["on"], e["why"], e["gain_db"]) for e in report["effects"]]  # noqa: E731
    assert decided(again) == decided(first)
