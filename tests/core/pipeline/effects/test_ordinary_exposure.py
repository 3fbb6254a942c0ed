"""What a run does that asks for no effect: exposures, where the photos show that they differ; and of unseen photos."""

import numpy as np
import pytest
import torch
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.imaging.medium import Medium
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects.ablation import Ablation, TrialTerms
from dgs.core.pipeline.effects.choose import choose_effects
from dgs.core.pipeline.effects.unseen import formation_of_all, with_unseen
from dgs.core.pipeline.fitted import SplitViews
from dgs.core.pipeline.simulated import simulate
from dgs.core.progress import Silent
from dgs.core.training.settings import TrainingSettings

SETTINGS = TrainingSettings(steps=30, max_gaussians=2000, sh_degree=0, threads=1)


class Listening(Silent):
    def __init__(self):
        self.notes = []

    def note(self, text):
        self.notes.append(text)


@pytest.fixture(scope="module")
def scene():
    return make_scene(3, width=192, height=128, views=12, finer=2)


def ordinary(photos, held=()):
    views = undistorted_views(list(photos.photos), photos.cameras)
    progress = Listening()
    fitted = [view for view in views if view.name not in held]
    chosen = choose_effects("usual", photos.photos, photos.cameras, fitted, Medium(), TrialTerms(SETTINGS), progress)
    return chosen, views, progress.notes


def test_photos_alike_are_left_alone(scene):
    chosen, views, notes = ordinary(validation.photo_set(scene, degrade(scene, Truth(), seed=1)))
    assert not chosen.formation and chosen.plain() == [] and notes == []
    assert all(a is b for a, b in zip(chosen.corrected(views), views, strict=True))


def test_photos_that_differ_are_said_to_and_learned(scene):
    photos = validation.photo_set(scene, degrade(scene, Truth(exposure=0.2), seed=1))
    chosen, views, notes = ordinary(photos)
    assert chosen.formation.names == ("exposure",) and len(notes) == 1 and "--effects none" in notes[0]
    (row,) = chosen.plain()
    assert row["name"] == "exposure" and row["on"] and row["evidence"]["needed"] and len(row["parameters"]) == 12


@pytest.mark.parametrize(("gain", "learned"), [(0.0, True), (-0.5, False)])
def test_auto_learns_what_a_run_learns_that_asks_for_nothing(scene, monkeypatch, gain, learned):
    """The trial shows nothing; or a loss, which contradicts."""
    photos = validation.photo_set(scene, degrade(scene, Truth(exposure=0.2), seed=1))

    def scores(self, arm, medium, pair):
        return np.full(6, 30.0 + gain * ("exposure" in arm.formation.names)) + 0.05 * np.arange(6) % 0.1

    monkeypatch.setattr(Ablation, "_scores", scores)
    views = undistorted_views(list(photos.photos), photos.cameras)
    asked = "auto,-haze,-vignetting,-saturation,-field_blur,-motion,-defocus"
    chosen = choose_effects(asked, photos.photos, photos.cameras, views, Medium(), TrialTerms(SETTINGS), Silent())
    line = next(d for d in chosen.decisions if d.name == "exposure")
    assert ("exposure" in chosen.formation.names) is learned and line.on is learned, line
    assert ("beyond doubt" if learned else "not confirmed") in line.why


def test_auto_learns_it_where_too_few_photos_are_there_for_a_trial(scene):
    photos = validation.photo_set(scene, degrade(scene, Truth(exposure=0.2), seed=1))
    views = undistorted_views(list(photos.photos), photos.cameras)[:3]
    asked = "auto,-haze,-vignetting,-saturation,-field_blur,-motion,-defocus"
    chosen = choose_effects(asked, photos.photos, photos.cameras, views, Medium(), TrialTerms(SETTINGS), Silent())
    assert chosen.formation.names == ("exposure",)
    assert "too few photos" in next(d for d in chosen.decisions if d.name == "exposure").why


def test_held_out_photos_are_not_looked_at(scene):
    photos = validation.photo_set(scene, degrade(scene, Truth(exposure=0.2), seed=1))
    views = undistorted_views(list(photos.photos), photos.cameras)
    split = SplitViews(views[1:], views[:1], [view.name for view in views])
    for asked in ("usual", "exposure"):
        found = simulate(asked, photos.photos, photos.cameras, split, Medium(), TrialTerms(SETTINGS), Silent())
        (exposure,) = found.chosen.formation.effects
        assert set(exposure.names) == {view.name for view in views[1:]}
        assert np.abs(found.heldout[0].planes() - views[0].planes()).max() < 1e-4
        gains = exposure.parameters["log_gains"].numpy()
        assert np.abs(gains.mean(axis=0)).max() < 1e-6


def numbered(gains):
    return Exposure([f"{2 * i:02d}.png" for i in range(len(gains))], torch.tensor(gains)[:, None].expand(-1, 3).float())


def test_unseen_photos_are_exposed_as_their_neighbours_where_those_are_alike():
    names = [f"{i:02d}.png" for i in range(21)]
    drifting = numbered(np.linspace(-0.5, 0.5, 11).tolist())
    expected = with_unseen(drifting, names)
    assert set(expected.names) == set(names) and expected.names[:11] == drifting.names
    rows = dict(zip(expected.names, expected.parameters["log_gains"].numpy(), strict=True))
    assert rows["07.png"] == pytest.approx([-0.15] * 3, abs=0.02)
    random = numbered(np.random.default_rng(3).uniform(-0.5, 0.5, 11).tolist())
    assert with_unseen(random, names) is random
    few = numbered([0.1, 0.0, -0.1])
    assert with_unseen(few, names) is few and with_unseen(drifting, drifting.names) is drifting
    nothing = Formation()
    assert formation_of_all(nothing, names) is nothing
    assert formation_of_all(Formation([drifting]), names).effects[0].names == expected.names
