"""The optimization: photos with cameras in, Gaussians out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..gaussians import Gaussians
from ..colour import srgb_to_linear
from ..imaging.medium import Medium
from ..imaging.spectrum import NoiseToSignal, noise_to_signal
from ..progress import Progress
from ..rasterizer import RasterSettings, render
from ..views import SparsePoints, View
from .density import DensityControl
from .grid import GridView, grid_step
from .initial import first_gaussians
from .objective import Objective
from .optimizer import Adam
from .scale import SceneScale, scene_scale, views_per_point
from .settings import TrainingSettings

#: Largest margin (grid px) rendered beyond the photo for the blur's sake.
MARGIN_SIGMAS = 3.0
#: Photos whose spectra are averaged for the noise-to-signal ratio.
SPECTRUM_VIEWS = 12


@dataclass
class Trained:
    """What `train` gives back.

    Attributes:
        gaussians: in the world of the cameras that came in.
        low_pass: variance (photo px^2) that was added to every projected Gaussian while training.
        history: one row per measurement: step, seconds, loss, gaussians, and heldout_psnr.
        counters: what was repaired, refused, added and removed.
        seconds: 'prepare', 'compile', 'train'.
        stopped: 'done', 'time limit' or 'cancelled'.
    """

    gaussians: Gaussians
    low_pass: float
    history: list[dict[str, float]]
    counters: dict[str, int]
    seconds: dict[str, float]
    steps: int
    stopped: str
    settings: TrainingSettings


@dataclass
class Level:
    """One resolution of the photos, with its objectives."""

    step: int
    views: list[GridView]
    heldout: list[GridView]
    margin: int
    ratio: NoiseToSignal | None = None
    objectives: dict[Any, Objective] = field(default_factory=dict)


class Trainer:
    """One run of the optimization, step by step."""

    def __init__(self, views: Sequence[View], heldout: Sequence[View], points: SparsePoints, medium: Medium,
                 settings: TrainingSettings) -> None:  # fmt: skip
        self.settings, self.medium = settings, medium
        self.device = torch.device("cpu")
        self.scale: SceneScale = scene_scale([v.camera for v in views], points)
        w, h = views[0].camera.width, views[0].camera.height
        self.step_size = grid_step(medium, w, h)
        self.views, self.heldout = views, heldout
        self.points = points
        fine = self._level(self.step_size)
        self.levels = [fine]
        if settings.coarse_share > 0 and min(w, h) // (2 * self.step_size) >= 96:
            self.levels = [self._level(2 * self.step_size), fine]
        random = np.random.default_rng([settings.seed, 0])
        level = self.levels[-1]
        gaussians = first_gaussians(
            [v.camera for v in level.views], lambda i: level.views[i].planes(),
            self.scale.points_to_unit(points.positions), points.colours, settings.max_gaussians,
            settings.sh_degree, random, margin=level.margin,
        )  # fmt: skip
        self.optimizer = Adam(gaussians)
        self.density = DensityControl(len(gaussians))
        self.step = 0

    def _level(self, step: int) -> Level:
        unit = self.scale.camera_to_unit
        make = lambda v: GridView(v, unit(v.camera), step, self.medium.psf_for(v.name), self.medium.blur_space)  # noqa: E731
        views, heldout = [make(v) for v in self.views], [make(v) for v in self.heldout]
        sigma = max((float(np.linalg.eigvalsh(v.psf.covariance)[-1]) ** 0.5 for v in views if v.psf), default=0.0)
        return Level(step, views, heldout, int(np.ceil(MARGIN_SIGMAS * sigma)), self._ratio(views, step))

    def _ratio(self, views: list[GridView], step: int) -> NoiseToSignal | None:
        """Noise over signal of the photos on a grid, shared by the views that see one point."""
        psf = next((v.psf for v in views if v.psf is not None), None)
        if psf is None or self.settings.loss == "paper":
            return None
        photos = [v.planes() for v in views[:: max(1, len(views) // SPECTRUM_VIEWS)]]
        if self.medium.blur_space == "linear":
            photos = [np.asarray(srgb_to_linear(p), np.float32) for p in photos]
        levels = float(np.iinfo(self.views[0].photo.dtype).max)
        measured = noise_to_signal(photos, psf, 1 / levels / 12**0.5 / step)
        cameras = [v.camera for v in views]
        return measured.shared_by(self.settings.noise_gain * views_per_point(cameras, self.scale, self.points))

    def objective(self, level: Level, view: GridView) -> Objective:
        """The objective for a view's size and point spread; made once."""
        key = (view.camera.height, view.camera.width, id(view.psf) if self.medium.per_view else 0)
        if key not in level.objectives:
            level.objectives[key] = Objective(
                view.psf, view.camera.height, view.camera.width, level.margin, self.medium.blur_space,
                self.settings, self.device, level.ratio,
            )  # fmt: skip
        return level.objectives[key]

    def raster_settings(self, level: Level) -> RasterSettings:
        """The low-pass is the same footprint on the photo whatever the grid."""
        return RasterSettings(low_pass=max(0.1, self.settings.low_pass / level.step**2))

    def rates(self, progress: float) -> dict[str, float]:
        """Step sizes at a share of the run."""
        r = self.settings.rates
        return {
            "means": r.means * (r.means_end / r.means) ** progress, "log_scales": r.log_scales,
            "quaternions": r.quaternions, "opacity_logits": r.opacity_logits, "sh": r.sh, "sh_rest": r.sh_rest,
        }  # fmt: skip

    def view_at(self, level: Level, step: int) -> GridView:
        """Every photo once per round, in an order that depends on seed and round only."""
        n = len(level.views)
        order = np.random.default_rng([self.settings.seed, 1, step // n]).permutation(n)
        return level.views[order[step % n]]

    def advance(self) -> float:
        """One iteration; returns the photo's loss."""
        s = self.settings
        progress = self.step / s.steps
        level = self.levels[0] if progress < s.coarse_share else self.levels[-1]
        view = self.view_at(level, self.step)
        rendered = render(
            self.optimizer.gaussians, view.camera.with_margin(level.margin), settings=self.raster_settings(level)
        )
        valid = None if view.valid is None else torch.from_numpy(view.valid)
        pull = self.objective(level, view).pull(rendered.image.detach(), torch.from_numpy(view.planes()), valid)
        torch.autograd.backward([rendered.image], [pull.gradient])
        self.density.collect(rendered.screen)
        self.optimizer.step(self.rates(progress))
        self.step += 1
        if self.step % s.density_every == 0 and self.step < s.density_until * s.steps:
            random = np.random.default_rng([s.seed, 2, self.step])
            self.density.act(self.optimizer, s.max_gaussians, random)
        return pull.loss


def train(views: Sequence[View], heldout: Sequence[View], points: SparsePoints, medium: Medium,
          settings: TrainingSettings, progress: Progress, checkpoint: Path | None = None,
          resume: bool = False) -> Trained:  # fmt: skip
    """Optimizes Gaussians against photos through the medium."""
    start = time.perf_counter()
    trainer = Trainer(views, heldout, points, medium, settings)
    prepared = time.perf_counter()
    progress.stage("train", settings.steps)
    history: list[dict[str, float]] = []
    for step in range(settings.steps):
        loss = trainer.advance()
        if step % 50 == 0 or step == settings.steps - 1:
            history.append({"step": step, "seconds": time.perf_counter() - start, "loss": loss, "gaussians": len(trainer.optimizer.gaussians)})
            progress.advance(step + 1, loss=loss)
        if progress.cancelled():
            break
    end = time.perf_counter()
    return Trained(
        gaussians=trainer.scale.to_world(trainer.optimizer.gaussians), low_pass=settings.low_pass, history=history,
        counters=dict(trainer.density.counts) | {f"refused {k}": v for k, v in trainer.optimizer.refused.items()},
        seconds={"prepare": prepared - start, "compile": 0.0, "train": end - prepared}, steps=trainer.step,
        stopped="done", settings=settings,
    )  # fmt: skip
