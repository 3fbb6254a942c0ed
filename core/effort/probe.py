"""A few iterations on this machine and this scene show what an iteration costs.

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
from ..numbers import number
from ..photos.load import Photo
from ..training.density.contribution import asking
from ..training.job import TrainingJob
from ..training.restored.course import edges
from ..training.restored.start import restores
from ..training.run import RUN
from ..training.scene import SCENE
from ..training.settings import start_share
from ..training.trainer import Trainer
from ..training.warmup import compile_kernels
from ..views import SparsePoints, View
from .model import PREDICTIONS, sample


@dataclass(frozen=True)
class ProbeSettings:
    """How iterations are timed."""

    counts: tuple[int, int] = number(
        (8_000, 32_000), "Gaussians", "of the budget, at which iterations are tried: a line through two points"
    )
    phase_seconds: float = number(0.25, "s", "for one number of Gaussians in one phase")
    fewest: int = number(3, "iterations", "for one number of Gaussians in one phase, however slow")
    most: int = number(50, "iterations", "the same, however quick: their median is sure by then")
    mean_share: float = number(0.9, "share", "of the budget that a run's Gaussians are on average: it begins with less")
    evaluation: float = number(0.35, "iterations", "that evaluating a held-out photo takes: no backward pass")
    fastest: float = number(1e-5, "s", "of a step without Gaussians, where noise makes the line cross zero")


PROBE = ProbeSettings()
#: The wall that photos without cameras hang on: a usual focal length (of the longer side), cameras so far apart, the
#: wall so far away and so bumpy (viewing distance 2), and so many points along a side. What costs time does not depend
#: on them much: how many px there are, how wide the blur is, how many Gaussians lie over one another.
FOCAL, APART, DISTANCE, BUMPS, POINTS = 1.2, 0.05, 2.0, 0.2, 24


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
        watched: held-out photos that are evaluated during a run.
        seconds: that the probe itself took.
        fitted: photos that a run is trained on, and asks what they need.
    """

    phases: tuple[Phase, ...]
    watched: int
    seconds: float
    fitted: int = 0

    def training(self, steps: int, gaussians: int) -> float:
        """Seconds of a run's iterations, held-out evaluations, and questions what the photos need."""
        mean = PROBE.mean_share * gaussians
        step = sum(phase.share * phase.seconds(mean) for phase in self.phases)
        steps = steps + round(asking(steps, self.fitted))
        return steps * step + RUN.evaluations * self.watched * PROBE.evaluation * self.phases[-1].seconds(mean)


def made_up(photos: Sequence[Photo]) -> tuple[list[View], SparsePoints]:
    """Some of the photos with cameras side by side before a wall, and points on it."""
    views = []
    for index, photo in enumerate(sample(photos)):
        width, height = photo.size
        focal = photo.focal_px or FOCAL * max(width, height)
        shift = np.array([APART * index, 0.0, 0.0])
        camera = Camera(photo.name, width, height, focal, focal, width / 2, height / 2, np.eye(3), shift)
        views.append(View(camera, photo.pixels, photo.mask, None, photo.alpha, photo.background))
    first = views[0].camera
    half = 0.75 * np.array([first.width, first.height]) / first.fx * DISTANCE
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, POINTS), np.linspace(-1, 1, POINTS)))
    depth = DISTANCE + BUMPS * np.sin(5 * x) * np.cos(4 * y)
    points = np.stack([x * half[0], y * half[1], depth], axis=1)
    return views, SparsePoints(points, np.full((len(points), 3), 128, np.uint8))


def probe(
    job: TrainingJob,
    fitted: int,
    heldout: int,
    counts: tuple[int, int] = PROBE.counts,
    phase_seconds: float = PROBE.phase_seconds,
) -> Speed:
    """Times iterations; takes a second or two, after the kernels are compiled.

    Args:
        job: a few views are enough, and no held-out ones; its steps and Gaussians do not matter.
        fitted, heldout: photos that the run will train on, and those it will watch.
        phase_seconds: for one number of Gaussians in one phase.
    """
    settings = job.settings
    compile_kernels(settings.sh_degree)
    began = time.perf_counter()
    few_views = PREDICTIONS.sampled
    chosen = list(job.views)[:: max(1, len(job.views) // few_views)][:few_views]
    share = settings.start_share * start_share(fitted) / start_share(len(chosen))
    quiet = replace(settings, start_share=share, density_every=10**9, time_limit=None, until=None)
    tables: list[dict[float, float]] = []
    numbers: list[int] = []
    for count in counts:
        trainer = Trainer(chosen, [], job.points, job.medium, replace(quiet, max_gaussians=count), job.formation)
        trainer.restore = job.restore
        numbers.append(len(trainer.optimizer.gaussians))
        tables.append({middle: _step(trainer, middle, phase_seconds) for _, middle in _parts(trainer)})
    few, many = numbers
    phases = []
    for length, middle in _parts(trainer):
        each = max(0.0, (tables[1][middle] - tables[0][middle]) / max(1, many - few))
        phases.append(Phase(length, max(PROBE.fastest, tables[0][middle] - each * few), each))
    return Speed(tuple(phases), min(heldout, SCENE.watched_views), time.perf_counter() - began, fitted)


def _parts(trainer: Trainer) -> list[tuple[float, float]]:
    """(length, middle) of the stretches of a run in which iterations are alike."""
    s = trainer.settings
    coarse = s.coarse_share if len(trainer.levels) > 1 else 0.0
    start = s.start_share if trainer.levels[-1].ratio is not None else 0.0
    changes = edges(coarse, trainer.restore and restores(trainer))
    ends = sorted({0.0, *(min(change, 1.0) for change in (*changes, start)), 1.0})
    return [(b - a, (a + b) / 2) for a, b in zip(ends, ends[1:], strict=False)]


def _step(trainer: Trainer, share: float, seconds: float) -> float:
    """Median seconds of an iteration; the first plans transforms and is not counted."""
    trainer.advance(share)
    taken: list[float] = []
    until = time.perf_counter() + seconds
    while len(taken) < PROBE.fewest or (time.perf_counter() < until and len(taken) < PROBE.most):
        began = time.perf_counter()
        trainer.advance(share)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)
