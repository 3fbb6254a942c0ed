"""Gaussians are left out where photos are learned by heart: when, how many, and what it leaves alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core.progress import Silent
from dgs.core.training.dropout import DROPOUT, learned_by_heart, left_out
from dgs.core.training.job import TrainingJob
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from scipy.ndimage import gaussian_filter

from .test_training_runs import Listens, StopsAfter, run
from .training_scenes import SHORT, Scene, blurred_scene, same

LONGER = replace(SHORT, steps=80, density_every=20)
NOTE = "Photos that are held out are explained much worse"


@pytest.fixture(scope="module")
def agreeing() -> Scene:
    return blurred_scene(sigma=0.0)


@pytest.fixture(scope="module")
def disagreeing(agreeing: Scene) -> Scene:
    """Three photos, each with clouds of its own."""
    random = np.random.default_rng(0)

    def clouded(photo: np.ndarray) -> np.ndarray:
        clouds = gaussian_filter(random.normal(size=photo.shape), (6, 6, 0))
        return np.clip(photo + 60.0 * clouds / clouds.std(), 0, 255).round().astype(np.uint8)

    views = [replace(view, photo=clouded(view.photo)) for view in agreeing.views[::4]]
    return replace(agreeing, views=views)


def test_held_out_photos_decide() -> None:
    gap = 10 * np.log10(DROPOUT.gap)
    assert learned_by_heart(25.0, 25.1 + gap, 0.5) and not learned_by_heart(25.0, 24.9 + gap, 0.5)
    assert not learned_by_heart(25.0, 40.0, DROPOUT.begin - 0.01)


def test_more_are_left_out_towards_the_end_and_the_others_stand_in_for_them() -> None:
    logits = torch.full((200_000,), -4.0)
    whole = torch.sigmoid(logits).mean().item()
    for share in (0.0, 0.5, 1.0):
        shown = torch.sigmoid(logits + left_out(len(logits), share, np.random.default_rng(1)))
        assert (shown == 0).float().mean().item() == pytest.approx(DROPOUT.most * share, abs=0.005)
        assert shown.mean().item() == pytest.approx(whole, rel=0.02)
    assert torch.equal(logits + left_out(len(logits), 0.0, np.random.default_rng(1)), logits)


def test_photos_that_agree_are_trained_with_all_gaussians(agreeing: Scene) -> None:
    watched: list[Trainer] = []
    heard = Listens()
    run(agreeing, LONGER, progress=heard, watch=watched.append)
    trainer = watched[-1]
    assert trainer.asked["dropout"] == 0 and not [note for note in heard.notes if note.startswith(NOTE)]
    assert trainer._shown(1.0) is trainer.optimizer.gaussians, "nothing is added, not even nothing"


def test_photos_that_disagree_are_trained_with_some_left_out(disagreeing: Scene) -> None:
    found: list[int] = []
    heard = Listens()

    def watch(trainer: Trainer) -> None:
        if trainer.asked["dropout"]:
            found.append(trainer.step)
            gone = torch.sigmoid(trainer._shown(0.99).opacity_logits) == 0
            assert 0.1 < gone.float().mean().item() < 0.3
            assert torch.isfinite(trainer.optimizer.gaussians.opacity_logits).all()

    run(disagreeing, LONGER, progress=heard, watch=watch)
    assert found and found[0] >= DROPOUT.begin * LONGER.steps
    assert len([note for note in heard.notes if note.startswith(NOTE)]) == 1, "said once"


def test_a_run_goes_on_with_them_left_out(disagreeing: Scene, tmp_path: Path) -> None:
    whole = run(disagreeing, LONGER)
    stopped = run(disagreeing, LONGER, progress=StopsAfter(70), checkpoint=tmp_path / "c.npz")
    went_on = run(disagreeing, LONGER, checkpoint=tmp_path / "c.npz", resume=True)
    assert stopped.steps < whole.steps == went_on.steps and same(whole.gaussians, went_on.gaussians)


@pytest.mark.parametrize("without", ["held out", "looked at"])
def test_without_photos_held_out_nothing_is_judged(disagreeing: Scene, without: str) -> None:
    """Nor in trials, which look at them at their end only."""
    views, asked = disagreeing.views, []
    heldout, looked_at = ([], True) if without == "held out" else (views[:1], False)
    job = TrainingJob(views[1:], heldout, disagreeing.points, disagreeing.medium, LONGER, evaluated=looked_at)
    train(job, Silent(), watch=lambda trainer: asked.append(trainer.asked["dropout"]))
    assert asked and not any(asked)
