"""A short training on the graphics card's back end ends where the CPU's does, and twice the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.devices import backend_named
from dgs.core.forward.compare import psnr_of
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.training.optics.exposures import SETTINGS
from dgs.core.training.trainer import Trainer
from dgs.studies.stability.photographed import SIGMA, small_set, trained_steps
from dgs.tests.back_ends import or_skip


def psnr(trainer: Trainer) -> float:
    """Mean PSNR (dB) of what the twin shows in its photos."""
    level = trainer.levels[-1]
    errors = [np.square(trainer.exposed(level, v).degraded.cpu().numpy() - v.planes()).mean() for v in level.views]
    return psnr_of([float(error) for error in errors])


def test_a_short_training_ends_where_the_cpu_s_does():
    """Last bits are worth up to 0.08 dB in one run (40 steps, right after splats were split: 0.7), and no more in one
    direction than in the other."""
    or_skip("gpu")
    photos = small_set(4)
    apart = []
    for seed in range(5):
        ours, theirs = (
            trained_steps(*photos, 60, device=device, density_every=20, seed=seed) for device in ("gpu", "cpu")
        )
        assert ours.device.type == "gpu"
        assert psnr(theirs) > 18.0
        apart.append(psnr(ours) - psnr(theirs))
    assert abs(np.median(apart)) < 0.05, apart


#: What comes down in a step besides images: pairs and culled ones, the loss, how many gradients were refused.
COUNTS = 200


@pytest.mark.parametrize(
    ("sigma", "evaluation"), [(0.0, "auto"), (SIGMA, "separable"), (SIGMA, "fourier"), (SIGMA, "direct")]
)
@pytest.mark.parametrize("masked", [False, True])
def test_a_step_brings_up_its_photo_and_nothing_else(sigma, evaluation, masked, monkeypatch):
    """Through a blur as without one: no image comes down, and none goes up but the photo and its mask, once."""
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    views, points, medium = small_set(2, sigma)
    if masked:
        mask = np.ones(views[0].photo.shape[:2], bool)
        mask[10:20, 15:30] = False
        views = [replace(view, mask=mask) for view in views]
    options = {"density_every": 1000, "sh_degree": 0, "coarse_share": 0.0, "blur_evaluation": evaluation}
    trainer = trained_steps(views, points, medium, 3, device="gpu", start_share=0.3, **options)
    traffic, pixels = card().traffic, views[0].camera.width * views[0].camera.height
    for kept in (True, False):
        if not kept:  # as those that there is no room for
            monkeypatch.setattr(backend_named("gpu"), "photo_bytes", 0)
            trainer._kept = None
        for share in (0.1, 0.5):  # towards photos that were sharpened, then with the inverted residual
            traffic.up = traffic.down = traffic.waits = 0
            trainer.advance(share)
            # (where a mask is filled before a photo is sharpened, that is done in the computer's memory)
            filled = masked and sigma and share < 0.3
            assert traffic.up == (12 * pixels * filled if kept else pixels * (12 + masked)), share
            assert traffic.down <= COUNTS and traffic.waits <= 1, share


def test_what_density_control_counts_stays_on_the_card():
    """It reads opacities, sizes and its scores; parameters and moments are chosen and put together on the card."""
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    trainer = trained_steps(*small_set(2), 6, device="gpu", density_every=1000)
    before = len(trainer.optimizer.gaussians)
    assert trainer.density.gradients.held.only_on_card and trainer.density.views.held.only_on_card
    card().traffic.down = 0
    trainer.density.act(trainer.optimizer, before + 60, np.random.default_rng(0))
    count = len(trainer.optimizer.gaussians)
    assert before < count <= before + 60
    assert card().traffic.down <= 12 * before + 40 * 60, card().traffic
    assert all(tensor.held.only_on_card for tensor in trainer.optimizer.first.values())
    assert all(len(tensor) == count for tensor in trainer.optimizer.second.values())


def test_the_same_seed_gives_the_same_twin():
    or_skip("gpu")
    photos = small_set(2)
    one, other = (trained_steps(*photos, 12, device="gpu", density_every=6) for _ in range(2))
    for (name, tensor), (_, again) in zip(
        one.optimizer.gaussians.named(), other.optimizer.gaussians.named(), strict=True
    ):
        assert torch.equal(tensor.cpu(), again.cpu()), name


def test_exposures_are_learned_on_the_card_s_photos():
    """As with the processor; of a step's images, no more comes down than exposures are learned from."""
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    views, points, medium = small_set(4)
    dark = [replace(view, photo=(0.8 * view.photo).astype(np.uint8)) if n % 2 else view for n, view in enumerate(views)]
    chain = Formation([Exposure([view.name for view in views], torch.zeros(len(views), 3))])
    found = {}
    for device in ("gpu", "cpu"):
        trainer = trained_steps(dark, points, medium, 60, device=device, density_every=20, formation=chain)
        found[device] = trainer.learned.exposures.values
    assert np.std(found["cpu"][..., 0]) > 0.02
    np.testing.assert_allclose(found["gpu"], found["cpu"], atol=0.02)
    trainer = trained_steps(dark, points, medium, 4, device="gpu", formation=chain)
    trainer.learned.exposures.settings = replace(SETTINGS, most_pixels=200)
    traffic, pixels = card().traffic, views[0].camera.width * views[0].camera.height
    traffic.up = traffic.down = 0
    trainer.advance(0.5)
    assert traffic.down < 12 * pixels / 4 and traffic.up < 3 * 4 * 16384 + 4096
