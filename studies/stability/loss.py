"""The loss and what follows its gradient: flat images, poison, masks, Adam, a medium that is not as it was said."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from ...core.colour import linear_to_srgb, srgb_to_linear
from ...core.errors import NonFiniteParameter
from ...core.forward.compare import mean_square
from ...core.frames import Frame
from ...core.imaging.formation.chain import Formation
from ...core.imaging.formation.effect import Shot
from ...core.imaging.formation.exposure import Exposure
from ...core.imaging.kernel_samples import disc
from ...core.imaging.medium import Medium
from ...core.imaging.operator import BlurOperator
from ...core.imaging.psf import PointSpread, point_spread_from_samples
from ...core.imaging.spectrum import NoiseToSignal
from ...core.rasterizer import ScreenStatistics
from ...core.training.density.control import DensityControl
from ...core.training.guards import drop_non_finite
from ...core.training.loss.objective import Objective
from ...core.training.loss.photometric import PhotometricLoss, photometric_reference, structural_similarity_map
from ...core.training.loss.specks import speck_gradient
from ...core.training.loss.variation import variation_gradient
from ...core.training.optimizer import Adam
from ...core.training.settings import TrainingSettings
from ...core.views import View
from .case import Site, case, explained, non_finite
from .photographed import HEIGHT, WIDTH, arc, corner_points, looking, misfit, photographs, small_set, trained_steps
from .scenes import random_scene

LEVELS = (0.0, 1e-7, 0.3, 0.9999, 1.0, 1e4)
OFFSETS = (0.0, 1e-7, 1e-3)
RATES = {"means": 1e-3, "log_scales": 1e-2, "quaternions": 1e-3, "opacity_logits": 0.1, "sh": 1e-2, "sh_rest": 1e-3}


def _noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


@case("loss", "SSIM of flat images", "never above 1", 1e-6, "the window's weights sum to 1 to float32's rounding")
def flat_similarity(site: Site) -> float:
    """Constant images, and x against x + 1e-7: a negative variance gives SSIM > 1 elsewhere."""
    excess = 0.0
    for level in LEVELS:
        for offset in OFFSETS:
            photo = torch.full((3, 40, 50), level)
            value, slope = PhotometricLoss(photo, ssim_weight=1.0).value_and_gradient(photo + offset)
            if not (math.isfinite(value) and bool(slope.isfinite().all())):
                return math.inf
            similar = structural_similarity_map(photo + offset, photo)
            excess = max(excess, -value, float(similar.max()) - 1.0)
    return excess


@case(
    "loss",
    "flat and nearly flat: value",
    "compiled equals float64",
    2e-5,
    "what SSIM makes of float32 images: variances of 1e-8 beside C2 = 9e-4",
)
def hard_images_value(site: Site) -> float:
    """Black, white, flat, nearly flat, a single bright px, HDR."""
    return max(_loss_errors())


def _loss_errors(gradients: bool = False) -> list[float]:
    flat, spot = torch.full((3, 33, 50), 0.5), torch.zeros(3, 33, 50)
    spot[:, 16, 25] = 1.0
    ramp = torch.linspace(0, 1, 50).expand(3, 33, 50).contiguous()
    noise, other = _noise(3, 33, 50, seed=1), _noise(3, 33, 50, seed=2)
    pairs = [
        (torch.zeros_like(flat), noise),
        (torch.ones_like(flat), noise),
        (flat, flat + 1e-3 * (noise - 0.5)),
        (spot, torch.zeros_like(flat)),
        (ramp, flat),
        (noise, other),
        (noise, 1.0 - noise),
    ]
    errors = []
    for photo, image in pairs:
        value, slope = PhotometricLoss(photo).value_and_gradient(image)
        leaf = image.double().requires_grad_()
        truth = photometric_reference(leaf, photo.double())
        (wanted,) = torch.autograd.grad(truth, leaf)
        relative = float((slope.double() - wanted).norm() / wanted.norm())
        errors.append(relative if gradients else abs(value - truth.item()))
    return errors


@case("loss", "flat and nearly flat: gradient", "compiled equals float64, relative", 1e-3, "the target")
def hard_images_gradient(site: Site) -> float:
    """The same images, backward."""
    return max(_loss_errors(gradients=True))


@case(
    "loss",
    "masked, NaN and saturated pixels",
    "their gradient is exactly 0, the rest undisturbed",
    0.0,
    "a count of violations",
)
def dead_pixels(site: Site) -> float:
    """One NaN in a photo poisons a whole loss elsewhere."""
    photo, image = _noise(3, 40, 50, seed=3), _noise(3, 40, 50, seed=4)
    mask = torch.ones(40, 50, dtype=torch.bool)
    mask[5:9, 7:30] = False
    poisoned = photo.clone()
    poisoned[:, ~mask] = math.nan
    poisoned[1, 20, 20] = math.inf
    bright = photo.clone()
    bright[:, ~mask] = 0.999
    violations = 0
    results = []
    for one, how in ((poisoned, {}), (photo, {"mask": mask}), (bright, {"saturation": 0.9989})):
        value, slope = PhotometricLoss(one, **how).value_and_gradient(image)  # type: ignore[arg-type]
        violations += not math.isfinite(value) or non_finite(slope)
        violations += int((slope[:, ~mask] != 0).sum())
        results.append(slope)
    violations += int((results[0][1, 20, 20] != 0).sum())
    # What stands under a mask changes nothing, to the bit.
    again = PhotometricLoss(bright, mask).value_and_gradient(image)[1]
    return float(violations + int((again != results[1]).sum()))


@case("loss", "1 % NaN pixels through the medium", "finite gradient", 0.0, "a count of non-finite values")
def nan_through_the_medium(site: Site) -> float:
    """The blur would spread a NaN over its whole width."""
    psf, settings, bad = PointSpread("gaussian", 2.0, 2.0), TrainingSettings(), 0
    photo = _noise(3, 48, 64, seed=5)
    photo[:, _noise(48, 64, seed=6) < 0.01] = math.nan
    valid = photo.isfinite().all(dim=0)
    for space in ("srgb", "linear"):
        for ratio in (None, _ratio()):
            objective = Objective(psf, Frame(48, 64, 8), space, settings, torch.device("cpu"), ratio)  # type: ignore[arg-type]
            for mask in (valid, torch.zeros_like(valid)):
                terms = [objective.loss] + ([objective.start_loss] if ratio is not None else [])
                for term in terms:
                    out = term(_noise(3, 64, 80, seed=7), photo, mask)
                    bad += non_finite(out.gradient) + (not math.isfinite(out.loss))
    return float(bad)


def _ratio():  # type: ignore[no-untyped-def]
    return NoiseToSignal(np.geomspace(1e-6, 1e2, 96), np.geomspace(1e-5, 1e3, 96), 1e-3)


@case("loss", "no pixel counts", "loss 0, gradient 0", 0.0, "a count of violations")
def nothing_counts(site: Site) -> float:
    """A photo that is masked as a whole: a mean over nothing."""
    photo, image = torch.full((3, 20, 30), math.nan), _noise(3, 20, 30)
    value, slope = PhotometricLoss(photo).value_and_gradient(image)
    exact = photometric_reference(image.double().requires_grad_(), photo.double())
    return float(value != 0.0) + float(int((slope != 0).sum())) + float(float(exact.detach()) != 0.0)


@case("loss", "variation and specks of flat images", "finite; 0 where nothing changes", 0.0, "a count of violations")
def flat_variation(site: Site) -> float:
    """The root of the sum of squares has no slope at 0."""
    violations = 0
    for level in LEVELS:
        flat = torch.full((3, 9, 11), level)
        violations += int((variation_gradient(flat) != 0).sum()) + int((speck_gradient(flat) != 0).sum())
    spikes = torch.zeros(3, 9, 11)
    spikes[:, 4, 5] = 1e4
    return float(violations + non_finite(variation_gradient(spikes)) + non_finite(speck_gradient(spikes)))


@case("loss", "Adam fed with poison", "moves nothing that is not finite, and counts it", 0.0, "a count of violations")
def poisoned_gradients(site: Site) -> float:
    """NaN, infinite and absurd gradients among good ones, then zeros and denormals, for 50 steps."""
    clean, spoiled, violations = Adam(random_scene(40, 1)), Adam(random_scene(40, 1)), 0
    for step in range(50):
        for optimizer, bad in ((clean, False), (spoiled, True)):
            random = torch.Generator().manual_seed(step)
            for _, tensor in optimizer.gaussians.named():
                tensor.grad = torch.randn(tensor.shape, generator=random)
                tensor.grad[9:] *= 1e-30 if step % 2 else 0.0
            means = optimizer.gaussians.means.grad
            assert means is not None
            poison = torch.tensor([math.nan, math.inf, -3e38])
            means[3] = poison if bad else torch.zeros(3)
            optimizer.step(RATES)
    for (_, one), (_, other) in zip(clean.gaussians.named(), spoiled.gaussians.named(), strict=True):
        violations += int((one != other).sum()) + non_finite(other)
    return float(violations + (spoiled.refused != {"means": 150}) + (clean.refused != {}))


@case(
    "loss",
    "non-finite Gaussians in training",
    "taken out and counted; all lost is a typed error",
    0.0,
    "a count of violations",
)
def lost_rows(site: Site) -> float:
    """A parameter that became NaN all the same."""
    optimizer = Adam(random_scene(40, 1))
    with torch.no_grad():
        optimizer.gaussians.means[5, 0] = math.nan
        optimizer.gaussians.sh[11, 0, 0] = math.inf
    violations = float(drop_non_finite(optimizer, 50) != {"means": 1, "sh": 1}) + float(len(optimizer.gaussians) != 38)
    with torch.no_grad():
        optimizer.gaussians.log_scales[:] = math.nan
    with explained(NonFiniteParameter):
        drop_non_finite(optimizer, 100)
    return violations + sum(non_finite(t) for t in optimizer.first.values())


@case("loss", "a density control of extremes", "finite, within the budget", 0.0, "a count of violations")
def density_of_extremes(site: Site) -> float:
    """Everything faded, gradients without limit, nothing seen."""
    violations = 0
    for logits, gradient in ((-12.0, 1.0), (20.0, 1e30), (0.0, 0.0), (0.0, math.nan), (0.0, math.inf)):
        optimizer = Adam(random_scene(60, 1))
        with torch.no_grad():
            optimizer.gaussians.opacity_logits[:] = logits
        density = DensityControl(60, torch.device("cpu"))
        density.collect(ScreenStatistics(torch.ones(60), mean_gradient=torch.full((60, 2), gradient)))
        density.act(optimizer, 70, np.random.default_rng(0))
        violations += not 30 <= len(optimizer.gaussians) <= 70
        violations += sum(non_finite(t) for _, t in optimizer.gaussians.named())
    return float(violations)


@case(
    "loss",
    "another medium than was said",
    "training ends finite and closer to the photos than it began",
    1.0,
    "loss at the end over loss at the start, for the worst of three",
)
def wrong_medium(site: Site) -> float:
    """The inverse crime: data made by the renderer that explains it. Here photos come from rays on textured planes,
    quantised, with noise, and the point spread is 20 % too wide, 20 % too narrow, or a disc said to be a Gaussian."""
    cameras = [looking(centre, np.zeros(3), f"{i}.png") for i, centre in enumerate(arc(6))]
    worst = 0.0
    for kernel in (1.25, 1.875, disc(3.0)):
        views, medium = photographs(cameras, kernel), Medium(PointSpread("gaussian", 1.5, 1.5))
        before = misfit(trained_steps(views, corner_points(200), medium, 0))
        trainer = trained_steps(views, corner_points(200), medium, 60)
        bad = sum(non_finite(t) for _, t in trainer.optimizer.gaussians.named())
        worst = max(worst, math.inf if bad else misfit(trainer) / before)
    return worst


@case(
    "loss",
    "a black and a white photo, exposures differ",
    "the others are explained as well as without the two, squared error over that",
    1.25,
    "1 dB: a white photo still says that nothing is quite dark",
)
def black_and_white_photos(site: Site) -> float:
    """Six photos up to 1.2 stops apart, a black one (the lens cap) and a white one (the flash), none of them known."""
    views, points, medium = small_set(8, sigma=0.0)
    stops = (0.6, -0.3, 0.0, 0.0, 0.3, -0.6, 0.4, -0.4)
    exposed = [_exposed(view, stop) for view, stop in zip(views, stops, strict=True)]
    black, white = (replace(views[i], photo=np.full_like(views[i].photo, value)) for i, value in ((2, 0), (3, 255)))
    others = [view for i, view in enumerate(exposed) if i not in (2, 3)]
    errors = []
    for photos in ([*others, black, white], others):
        start = Exposure([view.name for view in photos], torch.zeros(len(photos), 3))
        trainer = trained_steps(photos, points, medium, 30 * len(photos), formation=Formation([start]))
        if any(non_finite(t) for _, t in trainer.optimizer.gaussians.named()):
            return math.inf
        level, learned = trainer.levels[-1], trainer.learned.chain()
        shown = [v for v in level.views if v.name in {view.name for view in others}]
        filed = [learned.filed(trainer.exposed(level, v).degraded, Shot(v.name, HEIGHT, WIDTH)) for v in shown]
        errors.append(np.mean([mean_square(f.numpy() - v.planes()) for f, v in zip(filed, shown, strict=True)]))
    return float(errors[0] / errors[1])


def _exposed(view: View, stops: float) -> View:
    """The photo with its linear light times 2^stops."""
    light = srgb_to_linear(view.photo / 255.0) * 2.0**stops
    return replace(view, photo=np.round(linear_to_srgb(light).clip(0.0, 1.0) * 255).astype(np.uint8))


@case("loss", "blur and loss in float32", "gradient through the medium equals float64, relative", 1e-3, "the target")
def through_the_medium(site: Site) -> float:
    """Loss, adjoint and all, for a Gaussian, a tilted Gaussian and a disc."""
    errors = []
    tilted = PointSpread("gaussian", 3.0, 1.2, 25.0)
    for psf in (PointSpread("gaussian", 2.0, 2.0), tilted, point_spread_from_samples(disc(3.0))):
        image, photo = _noise(3, 48, 64, seed=8), _noise(3, 32, 48, seed=9)
        single_, double = (BlurOperator(psf, 32, 48, 8, dtype=t) for t in (torch.float32, torch.float64))
        slope = single_.adjoint(PhotometricLoss(photo).value_and_gradient(single_.apply(image))[1])
        leaf = image.double().requires_grad_()
        (truth,) = torch.autograd.grad(photometric_reference(double(leaf), photo.double()), leaf)
        errors.append(float((slope.double() - truth).norm() / truth.norm()))
    return max(errors)
