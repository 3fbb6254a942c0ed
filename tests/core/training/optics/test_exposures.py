"""Exposures that are learned with the Gaussians: gradients, the gauge, clipped photos, and that off changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.errors import CheckpointError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.imaging.medium import Medium
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.optics.exposures import SETTINGS, LearnedExposures, Slope
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, same

NAMES = ("a.png", "b.png", "c.png")


def learned(seed: int = 0) -> LearnedExposures:
    random = torch.Generator().manual_seed(seed)
    gains, offsets = torch.randn((2, 3, 3), generator=random, dtype=torch.float64)
    made = LearnedExposures(Exposure(NAMES, 0.1 * gains, 0.002 * offsets))
    made.values += np.random.default_rng(seed).normal(0, [0.05, 0.001], made.values.shape)
    return made


def picture(seed: int, size: int = 24) -> torch.Tensor:
    return torch.rand((3, size, size), generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * 0.6 + 0.15


def exposed(light: torch.Tensor, gain: torch.Tensor, offset: torch.Tensor) -> torch.Tensor:
    return gain[:, None, None].exp() * light + offset[:, None, None]


def test_gradients_are_those_of_the_written_objective():
    exposures, photo, shown = learned(), picture(1), picture(2)
    counts = torch.rand((24, 24), generator=torch.Generator().manual_seed(3)) > 0.3
    start = torch.from_numpy(exposures._start[1])
    now = torch.from_numpy(exposures.values[1].copy()).requires_grad_()
    filed = exposed(srgb_to_linear(photo), start[:, 0], start[:, 1])
    rest = linear_to_srgb(exposed(srgb_to_linear(shown), now[:, 0], now[:, 1])) - linear_to_srgb(filed)
    robust = ((1 + (rest / SETTINGS.knee) ** 2).sqrt() - 1)[:, counts].mean(dim=1).sum()
    priors = (now[:, 0] / SETTINGS.prior_gain) ** 2 + (now[:, 1] / SETTINGS.prior_offset) ** 2
    value = SETTINGS.independent * robust + priors.sum() / 2
    value.backward()
    slope = exposures.slope("b.png", photo, shown, counts)
    assert slope.value == pytest.approx(float(value.detach()), rel=1e-12)
    assert np.allclose(slope.gradient, now.grad.numpy(), rtol=1e-10, atol=1e-9)
    assert (np.linalg.eigvalsh(slope.curvature) > 0).all()


def test_steps_lower_the_objective_and_keep_the_gauge():
    exposures, photo, shown = learned(), picture(1), picture(1)
    before = exposures.slope("b.png", photo, shown).value
    for _ in range(20):
        exposures.learn("b.png", photo, shown, None)
        assert np.abs(exposures.values.mean(axis=0)).max() < 1e-12
    assert exposures.slope("b.png", photo, shown).value < 0.5 * before
    before = exposures.values.copy()
    exposures.learn("stranger.png", photo, shown, None)
    assert np.array_equal(exposures.values, before) and exposures.asked("stranger.png", photo, shown) is None


def test_a_black_photo_has_no_say_in_the_mean_exposure():
    exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
    for _ in range(60):
        exposures.learn("a.png", torch.zeros((3, 24, 24)), picture(2), None)
    assert exposures.values[0, :, 0].max() < -3 and np.abs(exposures.values[1:, :, 0]).max() < 1e-9


def test_a_photo_without_light_keeps_the_prior():
    exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
    for _ in range(10):
        exposures.learn("a.png", picture(1), picture(1), torch.zeros((24, 24), dtype=torch.bool))
    assert np.abs(exposures.values).max() == 0


def test_clipped_px_only_bound_the_light():
    exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
    photo, shown = torch.full((3, 2, 3), 0.5), torch.full((3, 2, 3), 0.5)
    photo[:, 0], shown[:, 0] = 1.0, torch.tensor([0.8, 1.0, 1.3])
    photo[:, 1, 0], shown[:, 1, 0] = 0.0, 0.002
    asked = exposures.asked("a.png", photo, shown)
    assert asked.photo[0, 0].tolist() == pytest.approx([1.0, 1.0, 1.3], abs=4e-5)  # at least white
    assert float(asked.photo[0, 1, 0]) == pytest.approx(0.002, abs=4e-5)  # at most black
    assert torch.allclose(asked.photo[:, 1, 1:], photo[:, 1, 1:], atol=4e-5) and float(asked.weight.max()) == 1.0
    exposures.values[0, :, 0] = np.log(0.5)
    asked = exposures.asked("a.png", photo, shown)
    twice = 2 * float(srgb_to_linear(photo)[0, 1, 1])
    assert float(srgb_to_linear(asked.photo)[0, 1, 1]) == pytest.approx(twice, rel=3e-4)
    assert float(asked.weight.max()) == pytest.approx(0.5 ** (1 / 2.4))


@pytest.fixture(scope="module")
def uneven():
    """A scene's photos with gains of up to 0.7 stops, and the gains (natural log)."""
    scene = blurred_scene(count=10, sigma=0.0)
    gains = np.random.default_rng(5).uniform(-0.5, 0.5, (10, 1)) + np.random.default_rng(6).normal(0, 0.05, (10, 3))
    gains -= gains.mean(axis=0)
    views = []
    for view, gain in zip(scene.views, gains, strict=True):
        filed = linear_to_srgb(srgb_to_linear(view.photo / 255.0) * np.exp(gain))
        views.append(replace(view, photo=np.round(filed.clip(0, 1) * 255).astype(np.uint8)))
    return scene, views, gains


def trained(views, scene, steps, formation=Formation(), begun=None):
    trainer = Trainer(views, [], scene.points, Medium(), replace(SHORT, steps=steps), formation)
    if begun is not None:
        restore(trainer, begun)
    while trainer.step < steps:
        trainer.advance(trainer.step / steps)
    return trainer


def without_knowledge(views):
    return Formation([Exposure([view.name for view in views], torch.zeros(len(views), 3))])


def test_gains_are_found_from_nothing(uneven):
    scene, views, gains = uneven
    trainer = trained(views, scene, 150, without_knowledge(views))
    found = trainer.learned.chain().effects[0].parameters["log_gains"].numpy()
    assert np.std(found - gains) < 0.04 < 0.2 < np.std(gains)
    assert np.abs(found.mean(axis=0)).max() < 1e-6


def test_a_checkpoint_goes_on_exactly(uneven):
    scene, views, _ = uneven
    formation = without_knowledge(views)
    whole = trained(views, scene, 40, formation)
    half = Trainer(views, [], scene.points, Medium(), replace(SHORT, steps=40), formation)
    while half.step < 20:
        half.advance(half.step / 40)
    state = checkpoint_of(half, 0.0, [])
    again = trained(views, scene, 40, formation, state)
    assert same(again.optimizer.gaussians, whole.optimizer.gaussians)
    assert np.array_equal(again.learned.exposures.values, whole.learned.exposures.values)
    for damaged in ({}, {"exposures": state.arrays["exposures"][:3]}, {"exposures": np.full((10, 3, 2), np.nan)}):
        kept = {name: array for name, array in state.arrays.items() if name != "exposures"} | damaged
        with pytest.raises(CheckpointError, match="exposures"):
            trained(views, scene, 40, formation, replace(state, arrays=kept))


def test_without_exposures_nothing_is_learned_or_kept(uneven):
    scene, views, _ = uneven
    plain = trained(views, scene, 10)
    assert plain.learned.exposures is None and "exposures" not in checkpoint_of(plain, 0.0, []).arrays
    strangers = trained(views, scene, 10, Formation([Exposure((), torch.zeros(0, 3))]))
    assert same(plain.optimizer.gaussians, strangers.optimizer.gaussians)


def test_of_a_large_photo_px_are_looked_at_evenly():
    """200 x 300 px are three times 20,000: every second row and column, from the middle of each pair on."""
    exposures, photo = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3))), picture(1, 300)[:, :200].float()
    shown, counts = picture(2, 300)[:, :200].float(), torch.rand((200, 300)) > 0.3
    asked = []
    usual = exposures.slope
    exposures.slope = lambda *given: asked.append(given) or usual(*given)
    exposures.learn("a.png", photo, shown, counts)
    name, photo_px, shown_px, counting = asked[0]
    assert name == "a.png" and photo_px.dtype == shown_px.dtype == torch.float64
    assert torch.equal(photo_px, photo[:, 1::2, 1::2].double()) and torch.equal(shown_px, shown[:, 1::2, 1::2].double())
    assert torch.equal(counting, counts[1::2, 1::2])
    exposures.learn("a.png", photo[:, :100, :200], shown[:, :100, :200], None)
    assert asked[1][1].shape == (3, 100, 200) and asked[1][3] is None, "20,000 px: all of them"


def test_a_visit_takes_a_part_of_the_step_and_no_more_than_one_at_most():
    def visited(gradient: list[float]) -> np.ndarray:
        exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
        curvature = np.broadcast_to(np.diag([2.0, 4.0]), (3, 2, 2))
        slope = Slope(0.0, np.broadcast_to(np.array(gradient), (3, 2)), curvature)
        exposures.slope = lambda *given: slope
        exposures.settle = lambda: None
        exposures.learn("b.png", picture(1), picture(2), None)
        assert not exposures.values[[0, 2]].any()
        return exposures.values[1, 0]

    assert visited([2.0, 1.0]) == pytest.approx([-0.3, -0.3 / 4])
    assert visited([40.0, 1.0]) == pytest.approx([-1.0, -0.3 / 4 / 6]), "both by the same factor"
    assert visited([-40.0, 0.0]) == pytest.approx([1.0, 0.0])
    assert visited([np.nan, 0.0]) == pytest.approx([0.0, 0.0])


def test_gains_stay_within_their_bounds_and_usual_ones_say_what_the_mean_is():
    exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
    exposures.values[:, :, 0] = [[9.0, 0.0, 0.0], [0.3, 0.1, 0.2], [0.1, 0.1, -0.2]]
    exposures.values[:, :, 1] = [[0.5] * 3, [0.2] * 3, [0.4] * 3]
    exposures.settle()
    np.testing.assert_allclose(exposures.values[0, :, 0], [4.8, -0.1, 0.0], atol=1e-12)  # 5 less the others' mean
    np.testing.assert_allclose(exposures.values[1:, :, 0], [[0.1, 0.0, 0.2], [-0.1, 0.0, -0.2]], atol=1e-12)
    np.testing.assert_allclose(exposures.values[:, 0, 1], [0.2, -0.1, 0.1], atol=1e-12)
    exposures.values[..., 0] = np.array([-9.0, 4.0, 2.0])[:, None]
    exposures.settle()
    np.testing.assert_allclose(exposures.values[:, 0, 0], np.array([-5.0, 4.0, 2.0]) - 1 / 3, atol=1e-12)


def test_a_fit_counts_no_px_whose_clipping_explains_it():
    """White px that the twin shows brighter still, and black ones darker, are settled; the other way they are not."""
    exposures = LearnedExposures(Exposure(NAMES, torch.zeros(3, 3)))
    photo = torch.tensor([1.0, 0.0, 0.5], dtype=torch.float64).expand(3, 1, 3)
    settled = torch.tensor([1.2, -0.1, 0.5], dtype=torch.float64).expand(3, 1, 3)
    assert exposures.slope("a.png", photo, settled).value == pytest.approx(0.0, abs=1e-9)
    off = torch.tensor([0.9, 0.1, 0.5], dtype=torch.float64).expand(3, 1, 3)
    each = (1 + (0.1 / SETTINGS.knee) ** 2) ** 0.5 - 1
    assert exposures.slope("a.png", photo, off).value == pytest.approx(SETTINGS.independent * 2 * each, rel=1e-6)


def test_exposures_are_learned_from_their_share_of_the_run_on(uneven):
    scene, views, _ = uneven
    trainer = Trainer(views[:2], [], scene.points, Medium(), replace(SHORT, steps=40), without_knowledge(views[:2]))
    seen = []
    trainer.learned.exposures.learn = lambda name, *given: seen.append(name)
    for share in (0.0, 0.049, 0.05, 0.5):
        trainer.advance(share)
    assert len(seen) == 2
