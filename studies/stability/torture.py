"""Twenty trainings on deliberately bad scenes: all end finite and better than they began, or say why they stopped."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from ...core.errors import DgsError
from ...core.imaging.kernel_samples import disc
from ...core.imaging.medium import Medium
from ...core.imaging.psf import PointSpread, point_spread_from_samples
from ...core.training.optimizer import Adam
from ...core.training.settings import Rates
from ...core.training.trainer import Trainer
from ...core.views import SparsePoints, View
from .photographed import arc, corner_points, looking, misfit, moved_world, photographs, trained_steps

STEPS = 500
#: A misfit below one 8-bit step leaves nothing to gain.
ONE_STEP = 1.0 / 255.0
VIEWS = 6


@dataclass(frozen=True)
class Torture:
    """One bad scene.

    Attributes:
        name: what is bad about it.
        views, points, medium: what is trained on.
        begin: alters what the training starts from.
        changes: of the training's settings.
        stops: whether it has to end with an explained error.
    """

    name: str
    views: list[View]
    points: SparsePoints
    medium: Medium
    begin: Callable[[Trainer], None] | None = None
    changes: dict[str, object] = field(default_factory=dict)
    stops: bool = False


@dataclass(frozen=True)
class TortureResult:
    """What became of it.

    Attributes:
        name: of the scene.
        before, after: mean photometric loss over all photos; NaN where it stopped.
        non_finite: values of the twin that are not finite.
        stopped: the explanation, or ''.
        seconds: wall time.
        passed: whether that is as it should be.
    """

    name: str
    before: float
    after: float
    non_finite: int
    stopped: str
    seconds: float
    passed: bool


def _blur(sigma: float = 1.5) -> Medium:
    return Medium(PointSpread("gaussian", sigma, sigma, source=f"gaussian:{sigma:g}"))


def _looking(centres: list[np.ndarray]) -> list:  # type: ignore[type-arg]
    return [looking(c, np.zeros(3), f"{i}.png") for i, c in enumerate(centres)]


def _with_masks(views: list[View], whole: int | None = None) -> list[View]:
    """1 % of the px do not count, as NaN px of a file do not; of view `whole` none counts."""
    random, out = np.random.default_rng(5), []
    for i, view in enumerate(views):
        mask = random.random(view.photo.shape[:2]) >= 0.01
        out.append(replace(view, mask=np.zeros_like(mask) if i == whole else mask))
    return out


def _painted(views: list[View], value: int) -> list[View]:
    return [replace(view, photo=np.full_like(view.photo, value)) for view in views]


def _start(name: str, value: float) -> Callable[[Trainer], None]:
    """Sets one parameter of all first Gaussians."""

    def begin(trainer: Trainer) -> None:
        gaussians = trainer.optimizer.gaussians.detached()
        if name == "needles":
            gaussians.log_scales[:, 0] += value
            gaussians.log_scales[:, 1:] -= value
            random = torch.Generator().manual_seed(0)
            gaussians.quaternions = torch.randn(gaussians.quaternions.shape, generator=random)
        else:
            getattr(gaussians, name)[:] = value
        trainer.optimizer = Adam(gaussians)

    return begin


def tortures() -> Iterator[Torture]:
    """The twenty."""
    cameras, points, medium = _looking(arc(VIEWS)), corner_points(200), _blur()
    views = photographs(cameras)
    rates = Rates()
    yield Torture("nothing bad, for comparison", views, points, medium)
    rail = [np.array([x, 0.0, -3.0]) for x in np.linspace(-0.8, 0.8, VIEWS)]
    yield Torture("collinear cameras, the paper's rail", photographs(_looking(rail)), points, medium)
    yield Torture("three photos", views[:3], points, medium)
    yield Torture("all-black photos", _painted(views, 0), points, medium)
    yield Torture("all-white photos", _painted(views, 255), points, medium)
    yield Torture("saturated: exposed four times too long", photographs(cameras, exposure=4.0), points, medium)
    yield Torture("1 % NaN px, one photo masked as a whole", _with_masks(views, 2), points, medium)
    yield Torture("PSF wider than the photo", views, points, _blur(40.0), stops=True)
    yield Torture("PSF of 0.4 of the photo's height", photographs(cameras, 19.0), points, _blur(19.0))
    yield Torture("PSF 20 % too wide", photographs(cameras, 1.25), points, medium)
    yield Torture("PSF of the wrong family", photographs(cameras, disc(3.0)), points, medium)
    yield Torture(
        "PSF with zeros in its transfer, linear light",
        photographs(cameras, disc(3.0)),
        points,
        Medium(point_spread_from_samples(disc(3.0)), "linear"),
    )
    yield Torture("world 1e6 away", *moved_world(views, points, 1.0, np.array([1e6, -1e6, 5e5])), medium)
    yield Torture("world in units of 1e-3, 1e6 units away", *moved_world(views, points, 1e-3, np.full(3, 1e3)), medium)
    yield Torture("needles to begin with, 1 : 1e5", views, points, medium, _start("needles", 5.8))
    yield Torture("giants to begin with, 1e4 scenes wide", views, points, medium, _start("log_scales", 9.2))
    yield Torture("all opaque to begin with", views, points, medium, _start("opacity_logits", 12.0))
    fast = replace(rates, **{n: 10 * getattr(rates, n) for n in rates.__dataclass_fields__})
    yield Torture("learning rates x 10", views, points, medium, changes={"rates": fast})
    centres = np.stack([view.camera.centre for view in views])
    at_cameras = SparsePoints(
        np.concatenate([points.positions, centres, centres + 1e-9]), np.full((200 + 2 * VIEWS, 3), 200, np.uint8)
    )
    yield Torture("points at the camera centres", views, at_cameras, medium)
    noise = np.random.default_rng(1).integers(0, 256, views[0].photo.shape).astype(np.uint8)
    yield Torture("the same photo of noise from everywhere", [replace(v, photo=noise) for v in views], points, medium)


def tortured(one: Torture, steps: int = STEPS) -> TortureResult:
    """Trains on one bad scene and judges the end."""
    began, before, after, bad, stopped = time.perf_counter(), math.nan, math.nan, 0, ""
    start: list[float] = []

    def begin(trainer: Trainer) -> None:
        if one.begin is not None:
            one.begin(trainer)
        start.append(misfit(trainer))

    try:
        trainer = trained_steps(one.views, one.points, one.medium, steps, begin, **one.changes)
        before, after = start[0], misfit(trainer)
        bad = sum(int((~t.isfinite()).sum()) for _, t in trainer.optimizer.gaussians.named())
        bad += sum(int((~t.isfinite()).sum()) for _, t in trainer.result().named())
    except DgsError as error:
        stopped = str(error)
        passed = one.stops and bool(error.way_out)
    else:
        passed = not one.stops and bad == 0 and math.isfinite(after) and after < max(before, ONE_STEP)
    return TortureResult(one.name, before, after, bad, stopped, time.perf_counter() - began, passed)
