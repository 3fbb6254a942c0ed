"""When a run is evaluated, what it reports, what it leaves, and what its trainer is made of."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from dgs.core.effects.vignetting import Vignetting
from dgs.core.errors import PsfError
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.spectrum import NoiseToSignal
from dgs.core.training import run as run_module
from dgs.core.training import scene as scene_module
from dgs.core.training.kept_state import counts_of, fingerprint_of
from dgs.core.training.level import round_variance
from dgs.core.training.loss.specks import speck_gradient, speck_gradient_in_torch
from dgs.core.training.loss.variation import variation_gradient, variation_gradient_in_torch
from dgs.core.training.ranks import ALONE
from dgs.core.training.restored.course import Part, part_of
from dgs.core.training.trainer import Trainer

from .test_training_runs import Listens, StopsAfter, run
from .training_scenes import SHORT, Scene, blurred_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return blurred_scene()


def same(first: Gaussians, second: Gaussians) -> bool:
    return all(torch.equal(a, b) for (_, a), (_, b) in zip(first.named(), second.named(), strict=True))


def test_a_run_is_evaluated_sixteen_times_evenly(scene: Scene) -> None:
    heard = Listens()
    rows = run(scene, progress=heard).history
    assert [row["step"] for row in rows] == [math.ceil(40 * k / 16) for k in range(1, 17)]
    # At each of them it is reported, and every tenth step besides.
    assert heard.steps == sorted({row["step"] for row in rows} | {10, 20, 30})


class Course:
    """A run whose steps take a second, and whose evaluations take five, by a clock of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, steps: int = 1_000_000) -> None:
        self.time, self.step, self.evaluated = 0.0, 0, []
        monkeypatch.setattr(run_module, "_Clock", lambda: self)
        monkeypatch.setattr(run_module, "_evaluation", self.evaluation)
        for asked in ("ask_photos", "adjust_cameras", "judge_dropout"):  # photos agree, and that takes no time here
            monkeypatch.setattr(run_module, asked, lambda *_: False)
        self.heard = Listens()
        settings = replace(SHORT, steps=steps)
        self.run = run_module._Run(self, settings, self.heard, None)  # type: ignore[arg-type]

    optimizer, ranks = SimpleNamespace(gaussians=None), ALONE

    def spent(self) -> float:
        return self.time

    def waited(self, question: Any) -> bool:
        return bool(question())

    def part(self, share: float) -> Part:
        return part_of(share, restores=False)

    def advance(self, share: float) -> float:
        assert 0.0 <= share < 1.0
        self.step += 1
        self.time += 1.0
        return 0.25

    def evaluation(self, trainer: Any, loss: float, seconds: float) -> dict[str, float]:
        self.evaluated.append(self.step)
        self.time += 5.0
        return {"step": self.step, "loss": loss, "seconds": seconds}

    def result(self) -> Gaussians:
        return SimpleNamespace(detached=lambda: None)  # type: ignore[return-value]


def test_the_last_evaluation_belongs_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    course = Course(monkeypatch)
    assert course.run.iterate(160.0, None) == "time limit"
    assert course.run.seconds == 155.0, "five seconds are left for it"
    course.run.finished("time limit")
    assert course.time <= 160.0 + 1.0


def test_without_a_limit_no_time_is_kept_back(monkeypatch: pytest.MonkeyPatch) -> None:
    course = Course(monkeypatch, steps=40)
    assert course.run.iterate(None, None) == "done" and course.step == 40


def test_with_a_limit_progress_is_that_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a million steps that were asked for, 160 s allow a hundred: what is reported goes from 0 to a million."""
    course = Course(monkeypatch)
    course.run.iterate(160.0, None)
    assert course.heard.steps == sorted(course.heard.steps)
    assert 0.9e6 < course.heard.steps[-1] <= 1_000_000 and course.heard.steps[0] < 0.2e6


@pytest.mark.parametrize("last", [20.0, 40.0])
def test_a_stopped_run_leaves_its_last_state_if_that_is_the_best(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, last: float
) -> None:
    kept = {}

    def evaluation(trainer: Any, loss: float, seconds: float) -> dict[str, float]:
        kept[trainer.step] = trainer.result()
        psnr = last if trainer.step == 24 else 30.0 if trainer.step == 5 else 25.0
        return {"step": trainer.step, "seconds": seconds, "loss": loss, "gaussians": 1, "heldout_psnr": psnr}

    monkeypatch.setattr(run_module, "_evaluation", evaluation)
    heard = Listens()
    stopped = run(scene, progress=(both := Both(heard, StopsAfter(24))))
    assert both.heard is heard and stopped.steps == 24 and max(kept) == 24
    assert same(stopped.gaussians, kept[24 if last == 40.0 else 5])
    assert [note for note in heard.notes if "that of step 5" in note] == heard.notes and bool(heard.notes) == (
        last < 40
    )


class Both(Listens):
    """Hears, and stops."""

    def __init__(self, heard: Listens, stops: StopsAfter) -> None:
        self.heard, self.stops = heard, stops

    def note(self, text: str) -> None:
        self.heard.note(text)

    def advance(self, done: int, **figures: float) -> None:
        self.heard.advance(done, **figures)

    def cancelled(self) -> bool:
        return self.stops.cancelled()


# --- the trainer ------------------------------------------------------------------------------------------------------


def made(scene: Scene, settings: Any = SHORT, medium: Medium | None = None, **options: Any) -> Trainer:
    views = options.pop("views", scene.views[:4])
    return Trainer(views, [], scene.points, scene.medium if medium is None else medium, settings, **options)


def test_one_photo_can_be_trained_on(scene: Scene) -> None:
    assert len(made(scene, views=scene.views[:1]).views) == 1


@pytest.mark.parametrize(("smallest", "steps"), [(48, [2, 1]), (49, [1])])
def test_small_photos_have_no_coarse_stage(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, smallest: int, steps: list[int]
) -> None:
    """Of 112 x 96 px half is 48 along the short side."""
    monkeypatch.setattr(scene_module, "GRID", replace(scene_module.GRID, smallest_side=smallest))
    one = replace(SHORT, grid_step=1, coarse_share=0.3)
    assert [level.step for level in made(scene, one).levels] == steps
    assert [level.step for level in made(scene, replace(one, coarse_share=0.0)).levels] == [1]


def test_noise_is_weighed_where_a_blur_is_inverted(scene: Scene) -> None:
    assert made(scene).levels[-1].ratio is not None
    assert made(scene, medium=Medium(None)).levels[-1].ratio is None
    assert made(scene, replace(SHORT, loss="paper")).levels[-1].ratio is None


def test_splats_that_nobody_sees_are_counted_at_every_step(scene: Scene) -> None:
    behind = torch.tensor([[0.0, 0.0, -50.0]])
    first = scene.truth
    start = Gaussians(torch.cat([first.means, behind]), *(torch.cat([t, t[:1]]) for _, t in list(first.named())[1:]))
    trainer = made(scene, start=start)
    for step in (1, 2, 3):
        trainer.advance(0.0)
        assert trainer.culled["behind"] == step


def test_a_checkpoint_belongs_to_its_effects(scene: Scene) -> None:
    darkened = Formation([Vignetting(torch.tensor([0.5] * 3))])
    assert list(fingerprint_of(made(scene, formation=darkened))["effects"]) == [darkened.effects[0].name]
    assert "effects" not in fingerprint_of(made(scene))


@pytest.mark.parametrize("name", ["samples", "unequal", "own", "some"])
def test_only_one_round_gaussian_widens_splats(name: str) -> None:
    def view(psf: PointSpread | None) -> Any:
        return SimpleNamespace(psf=psf)

    round_one = PointSpread("gaussian", 2.0, 2.0)
    wrong = {
        "unequal": [view(PointSpread("gaussian", 2.0, 2.1))],
        "own": [view(round_one), view(PointSpread("gaussian", 3.0, 3.0))],
        "some": [view(None), view(round_one)],
        "samples": [view(SimpleNamespace(samples=np.ones((3, 3)), sigma_x=2.0, sigma_y=2.0))],
    }[name]
    assert round_variance([view(round_one)] * 2) == 4.0 and round_variance([view(None)] * 2) == 0.0
    with pytest.raises(PsfError, match="round Gaussian"):
        round_variance(wrong)


# --- prices -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("knee", [math.inf, 0.05])
def test_the_compiled_smoothness_is_the_specification(knee: float) -> None:
    image = torch.from_numpy(np.random.default_rng(0).uniform(0, 1, (3, 7, 9)).astype(np.float32))
    wanted = variation_gradient_in_torch(image.double(), knee)
    torch.testing.assert_close(variation_gradient(image, knee).double(), wanted, atol=2e-5, rtol=1e-4)
    # The last column has no differences of its own: what is changed in it counts across only.
    image[:, :, :-1] = 0.5
    lone = variation_gradient_in_torch(image.double(), knee)
    assert lone[:, :, :-2].abs().max() == 0.0 < lone[:, :, -1].abs().min()


def test_the_compiled_price_of_specks_is_the_specification_to_the_border() -> None:
    image = torch.from_numpy(np.random.default_rng(1).uniform(0, 1, (3, 9, 11)).astype(np.float32))
    wanted = speck_gradient_in_torch(image.double())
    torch.testing.assert_close(speck_gradient(image).double(), wanted, atol=2e-4, rtol=1e-3)


# --- a run's figures --------------------------------------------------------------------------------------------------


def test_waiting_is_no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(run_module.time, "perf_counter", lambda: now[0])
    clock = run_module._Clock()
    now[0] += 5.0

    def question() -> bool:
        now[0] += 60.0
        return True

    assert clock.waited(question) is True and clock.spent() == 5.0
    now[0] += 2.0
    assert clock.waited(lambda: False) is False and clock.spent() == 7.0


def test_the_best_state_is_the_first_of_equal_ones_and_clearly_better() -> None:
    best = run_module._Best()
    assert best.step == 0 and not best.better_than({"heldout_psnr": -1e9}) and not best.better_than({})

    def trainer(step: int) -> Any:
        return SimpleNamespace(step=step, optimizer=SimpleNamespace(gaussians=SimpleNamespace(detached=lambda: step)))

    best.see(trainer(3), {"loss": 1.0})
    assert best.step == 0
    for step, psnr in ((5, 20.0), (6, 25.0), (7, 25.0), (8, 24.0)):
        best.see(trainer(step), {"heldout_psnr": psnr})
    assert (best.step, best.psnr, best.gaussians) == (6, 25.0, 6)
    assert best.better_than({"heldout_psnr": 24.94}) and not best.better_than({"heldout_psnr": 24.96})
    assert not best.better_than({})


@pytest.mark.parametrize(("psnr", "said"), [(None, {}), (20.0, {"heldout_psnr": 20.0})])
def test_a_row_of_the_history_says_what_it_is_of(
    monkeypatch: pytest.MonkeyPatch, psnr: float | None, said: dict[str, float]
) -> None:
    monkeypatch.setattr(run_module, "heldout_psnr", lambda trainer: psnr)
    trainer: Any = SimpleNamespace(step=7, optimizer=SimpleNamespace(gaussians=[0] * 5))
    row = {"step": 7, "seconds": 1.235, "loss": 0.25, "gaussians": 5}
    assert run_module._evaluation(trainer, 0.25, 1.23456) == {**row, **said}


def test_a_contradicted_blur_is_worth_a_note() -> None:
    table = np.ones(4)
    heard = Listens()
    run_module._warn_of_blur(None, heard)
    run_module._warn_of_blur(NoiseToSignal(table, table, 0.0, excess=1.0), heard)
    assert heard.notes == []
    run_module._warn_of_blur(NoiseToSignal(table, table, 0.0, excess=9.0, widest=0.7), heard)
    assert len(heard.notes) == 1 and "9 times" in heard.notes[0] and "70%" in heard.notes[0]


def test_a_resumed_run_counts_what_was_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """Its seconds, its history; checkpoints come every 25 s, and one at the end."""
    course = Course(monkeypatch, steps=60)
    saved: list[tuple[int, float]] = []
    monkeypatch.setattr(run_module.time, "perf_counter", lambda: course.time)
    monkeypatch.setattr(run_module, "save_checkpoint", lambda path, state: saved.append(state))
    monkeypatch.setattr(run_module, "checkpoint_of", lambda trainer, seconds, history: (trainer.step, seconds))
    monkeypatch.setattr(run_module, "fingerprint_of", lambda trainer: {})
    monkeypatch.setattr(run_module, "restore", lambda trainer, state: setattr(trainer, "step", state.step))
    kept = SimpleNamespace(step=20, seconds=100.0, history=[{"step": 20}])
    monkeypatch.setattr(run_module, "load_checkpoint", lambda path, fingerprint: kept)
    made = run_module._Run(course, replace(SHORT, steps=60), course.heard, tmp_path / "none.npz")  # type: ignore[arg-type]
    made.resume()
    assert course.step == 0, "there is none"
    (tmp_path / "some.npz").touch()
    made.checkpoint = tmp_path / "some.npz"
    made.resume()
    assert course.step == 20 and course.heard.notes == ["Going on from step 20"] and made.history == [{"step": 20}]
    assert made.iterate(None, None) == "done" and course.step == 60
    # Of 16 evaluations over 60 steps five were due before; each of the other eleven takes five seconds.
    assert len(course.evaluated) == 11 and made.seconds == 100.0 + 40.0 + 55.0
    assert (
        all(later[1] - earlier[1] > 25.0 for earlier, later in zip(saved, saved[1:], strict=False)) and len(saved) == 3
    )
    assert 125.0 < saved[0][1] <= 132.0
    made.finished("done")
    assert saved[3] == (60, 195.0) and len(made.history) == 12 and made.history[-1]["seconds"] == 190.0


def test_what_never_happened_is_counted_as_none(scene: Scene) -> None:
    assert set(counts_of(made(scene)).values()) == {0}
