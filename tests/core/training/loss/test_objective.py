"""What drives the render: the directions of both terms, masks, borders, and how far photos are trusted."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.frames import Frame
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.spectrum import BINS, NoiseToSignal
from dgs.core.training.loss.objective import Objective
from dgs.core.training.settings import PHOTO_COUNT, TrainingSettings, smoothness, trust

HEIGHT, WIDTH, MARGIN = 60, 84, 6
PSF = PointSpread(sigma_x=2.0, sigma_y=2.0)
RATIO = NoiseToSignal(np.full(BINS, 1e-4), np.full(BINS, 1e-4), 0.001)


def scene() -> torch.Tensor:
    """[3, H + 2m, W + 2m] smooth light with detail that the blur weakens but does not take."""
    y, x = torch.meshgrid(torch.arange(HEIGHT + 2 * MARGIN), torch.arange(WIDTH + 2 * MARGIN), indexing="ij")
    waves = 0.5 + 0.15 * torch.sin(x / 7.0) + 0.1 * torch.sin(y / 1.9 + x / 40.0)
    return torch.stack([waves, 0.9 * waves, 0.7 * waves + 0.1]).float()


def objective(space: str = "srgb", **settings: float) -> Objective:
    wanted = TrainingSettings(variation_weight=0.0, speck_weight=0.0, **settings)  # type: ignore[arg-type]
    return Objective(PSF, Frame(HEIGHT, WIDTH, MARGIN), space, wanted, torch.device("cpu"), RATIO)  # type: ignore[arg-type]


def photo_of(image: torch.Tensor, space: str = "srgb") -> torch.Tensor:
    blur = BlurOperator(PSF, HEIGHT, WIDTH, MARGIN, torch.device("cpu"))
    return blur.apply(image) if space == "srgb" else linear_to_srgb(blur.apply(srgb_to_linear(image)))


def inside(image: torch.Tensor) -> torch.Tensor:
    return image[:, MARGIN:-MARGIN, MARGIN:-MARGIN]


def correlation(a: torch.Tensor, b: torch.Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_the_inverted_residual_points_at_what_is_missing(space: str) -> None:
    truth = scene()
    blurred = BlurOperator(PSF, HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, 0, torch.device("cpu")).apply(truth)
    found = objective(space, base_weight=0.0).loss(blurred, photo_of(truth, space), None)
    middle = (slice(None), slice(12, -12), slice(12, -12))
    missing = inside(truth - blurred)[middle]
    assert correlation(-inside(found.gradient)[middle], missing) > 0.9
    assert found.gradient.isfinite().all()


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_nothing_moves_the_truth(space: str) -> None:
    truth = scene()
    blurred = BlurOperator(PSF, HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, 0, torch.device("cpu")).apply(truth)
    photo = photo_of(truth, space)
    at_truth, at_blurred = (objective(space, base_weight=0.0).loss(x, photo, None) for x in (truth, blurred))
    assert float(at_truth.gradient.norm()) < 1e-2 * float(at_blurred.gradient.norm())


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_the_start_draws_a_blurred_render_towards_the_sharp_scene(space: str) -> None:
    truth = scene()
    photo = photo_of(truth, space)
    render = torch.nn.functional.pad(photo[None], (MARGIN,) * 4, mode="replicate")[0]
    found = objective(space, ssim_weight=0.0).start_loss(render, photo, None)
    middle = (slice(None), slice(12, -12), slice(12, -12))
    wanted = (inside(truth) - photo)[middle]
    clear = wanted.abs() > 0.02  # the sign of a mean absolute error says nothing about less
    agree = torch.sign(-inside(found.gradient)[middle])[clear] == torch.sign(wanted)[clear]
    assert float(agree.float().mean()) > 0.97


@pytest.mark.parametrize("phase", ["start_loss", "loss"])
def test_masked_pixels_have_no_gradient(phase: str) -> None:
    truth = scene()
    photo = photo_of(truth)
    valid = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    valid[20:30, 30:50] = False
    wild = torch.where(valid, photo, 1.0 - photo)
    one, other = (getattr(objective(), phase)(0.9 * truth, p, valid) for p in (photo, wild))
    torch.testing.assert_close(one.gradient, other.gradient)
    assert one.loss == pytest.approx(other.loss)


def test_few_photos_are_trusted_less_and_smoothed_more() -> None:
    assert trust(36) == smoothness(36) == 1.0
    assert smoothness(1) == 2.0 and smoothness(10_000) == 0.5 and smoothness(12) > smoothness(70)
    assert trust(2) == PHOTO_COUNT.least_trust and trust(1000) == PHOTO_COUNT.most_trust
    assert trust(12) < trust(20) < trust(70)
