"""A few iterations on this machine and this scene tell what an iteration costs.

Before the cameras are known, the photos hang on a wall before made-up ones: how many pixels there are, how
wide the blur is, and how many Gaussians lie over one another in a picture is what costs time, not what is seen.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import Camera
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..photos.load import Photo
from ..training.run import LOOKS
from ..training.settings import TrainingSettings, start_share
from ..training.trainer import WATCHED_VIEWS, Trainer
from ..training.warmup import compile_kernels
from ..views import SparsePoints, View
from .model import VIEWS, sample

#: Gaussians (of the budget) at which it is tried.
COUNTS = (8_000, 32_000)
#: Seconds for one number of Gaussians in one phase, and iterations at least.
PHASE_SECONDS, LEAST = 0.25, 3
#: Gaussians on average over a run, as a share of the budget: it begins with less.
MEAN_SHARE = 0.9
#: A look at a held-out photo takes this share of an iteration.
LOOK = 0.35


@dataclass(frozen=True)
class Phase:
    """A part of a run: its share of the steps, and seconds of a step: `fixed + per_gaussian * N`."""

    share: float
    fixed: float
    per_gaussian: float

    def seconds(self, gaussians: float) -> float:
        """Of one step."""
        return self.fixed + self.per_gaussian * gaussians


@dataclass(frozen=True)
class Speed:
    """What a probe found.

    Attributes:
        phases: parts of a run in order.
        watched: held-out photos that are looked at during a run.
        seconds: that the probe itself took.
    """

    phases: tuple[Phase, ...]
    watched: int
    seconds: float

    def training(self, steps: int, gaussians: int) -> float:
        """Seconds of a run's iterations and looks."""
        mean = MEAN_SHARE * gaussians
        step = sum(phase.share * phase.seconds(mean) for phase in self.phases)
        return steps * step + LOOKS * self.watched * LOOK * self.phases[-1].seconds(mean)


def made_up(photos: Sequence[Photo]) -> tuple[list[View], SparsePoints]:
    """Some of the photos with cameras side by side before a wall, and points on it."""
    views = []
    for index, photo in enumerate(sample(photos)):
        width, height = photo.size
        focal = photo.focal_px or 1.2 * max(width, height)
        shift = np.array([0.05 * index, 0.0, 0.0])
        camera = Camera(photo.name, width, height, focal, focal, width / 2, height / 2, np.eye(3), shift)
        views.append(View(camera, photo.pixels, photo.mask))
    first = views[0].camera
    half = 0.75 * np.array([first.width, first.height]) / first.fx * 2.0
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 24), np.linspace(-1, 1, 24)))
    depth = 2.0 + 0.2 * np.sin(5 * x) * np.cos(4 * y)
    points = np.stack([x * half[0], y * half[1], depth], axis=1)
    return views, SparsePoints(points, np.full((len(points), 3), 128, np.uint8))


def probe(
    views: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    settings: TrainingSettings,
    fitted: int,
    heldout: int,
    counts: tuple[int, int] = COUNTS,
    formation: Formation = Formation(),
    phase_seconds: float = PHASE_SECONDS,
) -> Speed:
    """Times iterations; takes a second or two, after the kernels are compiled.

    Args:
        views: a few are enough (`VIEWS` are used); points: what cameras came with.
        settings: of the run; its steps and Gaussians do not matter.
        fitted, heldout: photos that the run will train on, and those it will watch.
        phase_seconds: for one number of Gaussians in one phase.
    """
    compile_kernels(settings.sh_degree)
    began = time.perf_counter()
    chosen = list(views)[:: max(1, len(views) // VIEWS)][:VIEWS]
    share = settings.start_share * start_share(fitted) / start_share(len(chosen))
    quiet = replace(settings, start_share=share, density_every=10**9, time_limit=None, until=None)
    tables: list[dict[float, float]] = []
    numbers: list[int] = []
    for count in counts:
        trainer = Trainer(chosen, [], points, medium, replace(quiet, max_gaussians=count), formation)
        numbers.append(len(trainer.optimizer.gaussians))
        tables.append({middle: _step(trainer, middle, phase_seconds) for _, middle in _parts(trainer)})
    few, many = numbers
    phases = []
    for length, middle in _parts(trainer):
        slope = max(0.0, (tables[1][middle] - tables[0][middle]) / max(1, many - few))
        phases.append(Phase(length, max(1e-5, tables[0][middle] - slope * few), slope))
    return Speed(tuple(phases), min(heldout, WATCHED_VIEWS), time.perf_counter() - began)


def _parts(trainer: Trainer) -> list[tuple[float, float]]:
    """(length, middle) of the stretches of a run in which iterations are alike."""
    s = trainer.settings
    coarse = s.coarse_share if len(trainer.levels) > 1 else 0.0
    start = s.start_share if trainer.levels[-1].ratio is not None else 0.0
    edges = sorted({0.0, min(coarse, 1.0), min(start, 1.0), 1.0})
    return [(b - a, (a + b) / 2) for a, b in zip(edges, edges[1:], strict=False)]


def _step(trainer: Trainer, share: float, seconds: float) -> float:
    """Median seconds of an iteration; the first plans transforms and is not counted."""
    trainer.advance(share)
    taken: list[float] = []
    until = time.perf_counter() + seconds
    while len(taken) < LEAST or (time.perf_counter() < until and len(taken) < 50):
        began = time.perf_counter()
        trainer.advance(share)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)
