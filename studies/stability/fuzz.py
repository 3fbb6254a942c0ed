"""Random scenes of anything at all: finite images and gradients come out, or the splat is culled and counted.

A scene goes the whole way of a training step: projection and blending, blur, loss, and back.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ...core import compiled
from ...core.camera import Camera
from ...core.constants import ALPHA_MINIMUM, SH_COEFFICIENTS
from ...core.conventions import rotation_from_quaternion
from ...core.devices import BackendName, tensors_on
from ...core.gaussians import Gaussians
from ...core.imaging.kernel_samples import disc
from ...core.imaging.operator import BlurOperator
from ...core.imaging.psf import PointSpread, point_spread_from_samples
from ...core.rasterizer import RasterSettings, render
from ...core.training.loss.photometric import PhotometricLoss

#: What poison is made of, besides any finite number.
SPECIAL = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38, 3.4e38, -3.4e38, 1.0, -1.0], np.float32)
#: Shares of poisoned values in a scene.
RATES = (0.0, 0.02, 0.1, 0.5)
#: width, height in px; the reach of the blur is added.
SIZES = ((1, 1), (16, 16), (17, 5), (33, 40), (5, 70))
MAXIMUM_SPLATS = 12


@dataclass
class Fuzzed:
    """What came of some scenes.

    Attributes:
        scenes, splats: how many.
        non_finite: values of images, losses and gradients that are NaN or infinite.
        uncounted: splats that are neither seen nor counted as culled, and poisoned ones that were drawn.
        culled: splats by reason.
        seconds: wall time.
        worst: seeds of scenes that broke a law, the first ten.
    """

    scenes: int = 0
    splats: int = 0
    non_finite: int = 0
    uncounted: int = 0
    culled: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    worst: list[int] = field(default_factory=list)


def values(random: np.random.Generator, shape: tuple[int, ...], mean: float, spread: float, rate: float) -> Tensor:
    """Ordinary numbers, and a share `rate` of extreme and special ones, float32."""
    out = mean + spread * random.standard_normal(shape)
    which = random.random(shape)
    extreme = np.sign(random.standard_normal(shape)) * 10.0 ** random.uniform(-38, 38.5, shape)
    out = np.where(which < 0.5 * rate, extreme, out)
    out = np.where(which < 0.25 * rate, SPECIAL[random.integers(0, len(SPECIAL), shape)], out)
    with np.errstate(over="ignore"):
        return torch.from_numpy(out.astype(np.float32))


def any_splats(random: np.random.Generator) -> Gaussians:
    """0 to 12 Gaussians of any degree, around three units before a camera at the origin."""
    count, coefficients, rate = (
        int(random.integers(0, MAXIMUM_SPLATS + 1)),
        SH_COEFFICIENTS[random.integers(0, 4)],
        random.choice(RATES),
    )
    return Gaussians(
        means=values(random, (count, 3), 0.0, 1.0, rate) + torch.tensor([0.0, 0.0, float(random.choice([0.0, 3.0]))]),
        log_scales=values(random, (count, 3), -2.0, 1.5, rate),
        quaternions=values(random, (count, 4), 0.0, 1.0, rate),
        opacity_logits=values(random, (count,), 0.0, 2.0, rate),
        sh=values(random, (count, coefficients, 3), 0.0, 0.5, rate),
    )


def any_camera(random: np.random.Generator) -> Camera:
    """A finite camera of any lens near the origin, in one of three worlds."""
    width, height = SIZES[random.integers(0, len(SIZES))]
    focal = 10.0 ** random.uniform(0, 3)
    turn = rotation_from_quaternion(np.array([3.0, 0, 0, 0]) + 0.3 * random.standard_normal(4))
    return Camera(
        "fuzz",
        width,
        height,
        focal,
        focal * random.uniform(0.7, 1.4),
        width * random.uniform(0, 1),
        height * random.uniform(0, 1),
        turn,
        0.1 * random.standard_normal(3),
    )


def any_settings(random: np.random.Generator) -> RasterSettings:
    """Any low-pass, antialiasing, cutoff, with or without depth."""
    return RasterSettings(
        low_pass=float(random.choice([0.05, 0.3, 2.0])),
        antialias=bool(random.integers(0, 2)),
        alpha_minimum=float(random.choice([ALPHA_MINIMUM, 0.0])),
        depth=bool(random.integers(0, 2)),
    )


def _kernels() -> list[PointSpread]:
    """Narrow, wide, tilted, round; none wider than half the smallest frame allows."""
    return [
        PointSpread("gaussian", 0.4, 0.4),
        PointSpread("gaussian", 0.5, 0.2, 30.0),
        PointSpread("gaussian", 1e-6, 0.3),
        point_spread_from_samples(disc(0.4)),
        PointSpread("gaussian", 2.0, 2.0),
        PointSpread("gaussian", 2.4, 0.7, 70.0),
        point_spread_from_samples(disc(2.0)),
    ]


class Fuzzer:
    """Draws and checks scenes; keeps blurs, which take longer to build than to use."""

    def __init__(self, backend: BackendName = "cpu") -> None:
        self.backend, self.device = backend, tensors_on(backend)
        self.kernels, self.blurs = _kernels(), dict[tuple[int, int, int], BlurOperator]()
        self.found = Fuzzed()

    def blur(self, which: int, width: int, height: int) -> BlurOperator:
        """The blur of a frame without margin; forced evaluations, so that all are met."""
        key = which, width, height
        if key not in self.blurs:
            widest = float(np.linalg.eigvalsh(self.kernels[which].covariance)[-1]) ** 0.5
            psf = self.kernels[which] if widest <= min(width, height) / 2 else None
            evaluation = "fourier" if psf is not None and which % 2 else "auto"
            self.blurs[key] = BlurOperator(psf, height, width, 0, self.device, evaluation=evaluation)
        return self.blurs[key]

    def check(self, seed: int) -> bool:
        """Draws the scene of a seed and lets it through; whether every law held."""
        random = np.random.default_rng(seed)
        scene, camera = any_splats(random), any_camera(random)
        return self.through(scene, camera, any_settings(random), random, seed)

    def through(
        self, scene: Gaussians, camera: Camera, settings: RasterSettings, random: np.random.Generator, seed: int
    ) -> bool:
        """Forward, blur, loss and back for one scene."""
        found, count = self.found, len(scene)
        leaves = scene.to(device=self.device).detached().requires_grad_()
        behind = torch.from_numpy(random.random(3).astype(np.float32)).to(self.device)
        view = render(leaves, camera, background=behind, settings=settings, backend=self.backend)
        blur = self.blur(int(random.integers(0, len(self.kernels))), camera.width, camera.height)
        seen = blur.apply(view.image.detach())
        photo = values(random, (3, camera.height, camera.width), 0.5, 0.3, float(random.choice(RATES)))
        photo = torch.where(photo.abs() < 1e6, photo, torch.nan)
        value, slope = PhotometricLoss(photo).value_and_gradient(seen.cpu().contiguous())
        # The loss divides by the number of px: brought to size 1, so that a step of any size is met.
        weights = blur.adjoint(slope.to(self.device)) * photo.numel()
        weighted = (view.image * weights).sum() + (view.alpha * weights[0]).sum()
        if view.depth is not None:
            weighted = weighted + (view.depth * weights[1]).sum()
        gradients = torch.autograd.grad(weighted, [t for _, t in leaves.named()], allow_unused=True)
        outputs = [view.image, view.alpha, view.depth, seen, slope, weights, torch.tensor(value), *gradients]
        bad = sum(int((~t.detach().isfinite()).sum()) for t in outputs if t is not None)
        poisoned = ~torch.stack(
            [t.flatten(1).isfinite().all(1) if t.ndim > 1 else t.isfinite() for _, t in scene.named()]
        ).all(0)
        shown = view.screen.radius.cpu() > 0
        uncounted = abs(count - int(shown.sum()) - sum(view.screen.culled.values())) + int((shown & poisoned).sum())
        # (harmonics of 1e38 may count as non-finite, too: their sums are)
        uncounted += int(poisoned.sum()) > view.screen.culled.get("non_finite", 0)
        found.scenes, found.splats = found.scenes + 1, found.splats + count
        found.non_finite, found.uncounted = found.non_finite + bad, found.uncounted + uncounted
        for reason, n in view.screen.culled.items():
            found.culled[reason] = found.culled.get(reason, 0) + n
        if (bad or uncounted) and len(found.worst) < 10:
            found.worst.append(seed)
        return not bad and not uncounted


def fuzz(
    scenes: int, backend: BackendName = "cpu", seed: int = 0, report: Callable[[int], None] | None = None
) -> Fuzzed:
    """Checks `scenes` scenes, seeds `seed`, `seed` + 1, ...; `report` hears how many are done, every hundred."""

    began, threads, fuzzer = time.perf_counter(), compiled.threads(), Fuzzer(backend)
    compiled.set_threads(1)  # frames of a few px: threads would only wait for one another
    try:
        for index in range(scenes):
            fuzzer.check(seed + index)
            if report is not None and index % 100 == 99:
                report(index + 1)
    finally:
        compiled.set_threads(threads)
    fuzzer.found.seconds = time.perf_counter() - began
    return fuzzer.found
