"""Gaussians are left out where photos are learned by heart: when, how many, and what it leaves alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.progress import Silent
from dgs.core.training.density.dropout import DROPOUT, getting_worse, learned_by_heart, left_out
from dgs.core.training.job import TrainingJob
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from scipy.ndimage import gaussian_filter

from ..test_training_runs import Listens, StopsAfter, run
from ..training_scenes import SHORT, Scene, blurred_scene, same

LONGER = replace(SHORT, steps=80, density_every=20)
NOTE = "Photos that are held out get worse"


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
    assert learned_by_heart(25.0, 25.1 + gap) and not learned_by_heart(25.0, 24.9 + gap)
    assert not getting_worse([]) and not getting_worse([25.0, 24.0, 24.0]), "too few to say"
    assert getting_worse([24.0, 25.0, 24.9, 24.0, 24.8])
    assert not getting_worse([24.0, 25.0, 24.9, 24.96, 24.8]) and not getting_worse([24.0, 24.5, 24.9, 25.0, 24.8])


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


@pytest.mark.parametrize("without", ["held out", "looked at", "a blur inverted"])
def test_where_it_is_not_judged(disagreeing: Scene, without: str) -> None:
    """Trials look at held-out photos at their end only; where a blur is inverted, invented detail has its price."""
    views, asked = disagreeing.views, []
    medium = Medium(PointSpread("gaussian", 2.0, 2.0)) if without == "a blur inverted" else disagreeing.medium
    heldout, looked_at = ([] if without == "held out" else views[:1]), without != "looked at"
    job = TrainingJob(views[1:], heldout, disagreeing.points, medium, LONGER, evaluated=looked_at)
    train(job, Silent(), watch=lambda trainer: asked.append(trainer.asked["dropout"]))
    assert asked and not any(asked)
