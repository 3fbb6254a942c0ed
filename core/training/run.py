"""A whole training run: plan, progress, held-out accuracy, checkpoints, time limit, cancel."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from .. import compiled
from ..constants import LOW_PASS_VARIANCE
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..imaging.spectrum import NoiseToSignal
from ..progress import Progress
from ..views import SparsePoints, View
from .checkpoint import load_checkpoint, save_checkpoint
from .schedule import Schedule
from .settings import TrainingSettings
from .trainer import Trainer
from .warmup import compile_kernels

#: Seconds between two checkpoints. With an iteration and the writing, a kill loses less than 30 s of the optimization.
CHECKPOINT_SECONDS = 25.0
#: How often the held-out photos are looked at during a run, and one that waits for an accuracy.
LOOKS, LOOKS_UNTIL = 16, 40
#: However long the preparation took, iterations get this share of the time limit.
LEAST_ITERATING = 0.2
#: A stopped run leaves its best look instead of its last state if that was better by more than this (dB).
BETTER_DB = 0.05
#: Steps between two reports of progress.
REPORT_EVERY = 10


@dataclass
class Trained:
    """What `train` gives back.

    Attributes:
        gaussians: in the world of the cameras that came in, to be drawn with the usual low-pass.
        low_pass: variance (px^2) to draw them with.
        background: [3] sRGB colour behind them.
        history: one row per look: step, seconds, loss, gaussians and, if photos are held out,
            heldout_psnr (dB, degraded render against photo).
        counters: what was added, removed, refused and repaired.
        seconds: 'prepare', 'compile', 'train', 'finish'.
        steps: iterations done.
        stopped: 'done', 'time limit', 'quality', 'plateau' or 'cancelled'.
        settings: what was used.
    """

    gaussians: Gaussians
    low_pass: float
    background: tuple[float, float, float]
    history: list[dict[str, float]]
    counters: dict[str, int]
    seconds: dict[str, float]
    steps: int
    stopped: str
    settings: TrainingSettings


def train(
    views: Sequence[View],
    heldout: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    settings: TrainingSettings,
    progress: Progress,
    checkpoint: Path | None = None,
    resume: bool = False,
    watch: Callable[[Trainer], None] | None = None,
    formation: Formation = Formation(),
) -> Trained:
    """Optimizes Gaussians against photos through the medium.

    Args:
        views: photos to fit, with cameras in any world.
        heldout: photos to watch only; never fitted.
        points: sparse points in the same world.
        checkpoint: file that the state is kept in; None for none.
        resume: go on from `checkpoint` if it is there.
        watch: called after every iteration; may look, and must not change anything.
        formation: effects besides the point spread, see `Trainer`.

    Raises:
        CheckpointError: the checkpoint is damaged or belongs to another run.
        NonFiniteParameter: the optimization diverged beyond repair.
        OutputError: the checkpoint cannot be written.
    """
    if settings.threads:
        compiled.set_threads(settings.threads)
        torch.set_num_threads(settings.threads)
    start = time.perf_counter()
    progress.stage("compile")
    compile_kernels(settings.sh_degree)
    compiled_at = time.perf_counter()
    trainer = Trainer(views, heldout, points, medium, settings, formation)
    _warn_of_blur(trainer.levels[-1].ratio, progress)
    history: list[dict[str, float]] = []
    before = 0.0
    if resume and checkpoint is not None and checkpoint.exists():
        state = load_checkpoint(checkpoint, trainer.fingerprint())
        trainer.restore(state)
        history, before = state.history, state.seconds
        progress.note(f"Going on from step {state.step}")
    prepared = time.perf_counter()
    progress.stage("train", settings.steps)
    limit = None
    if settings.time_limit is not None:
        limit = max(settings.time_limit - (prepared - start), LEAST_ITERATING * settings.time_limit)
    schedule = Schedule(settings, limit, trainer.step)
    clock, keeper = _Clock(), _Best()
    looks = LOOKS if settings.until is None else LOOKS_UNTIL
    stopped, saved, loss, cost = "done", prepared, 0.0, 0.0
    looked = int(schedule.share(trainer.step, 0.0) * looks + 1e-9)
    while True:
        if clock.waited(progress.cancelled):
            stopped = "cancelled"
            break
        spent = clock.spent()
        # The last look takes as long as the one before, and belongs to the run.
        ending = schedule.ended(trainer.step, spent if limit is None else spent + cost)
        if ending is not None:
            stopped = ending
            break
        share = schedule.share(trainer.step, spent)
        loss = trainer.advance(min(share, 1.0 - 1e-9))
        spent = clock.spent()
        share = schedule.share(trainer.step, spent)
        done = trainer.step if limit is None else min(round(share * settings.steps), settings.steps)
        if int(share * looks + 1e-9) > looked:
            looked = int(share * looks + 1e-9)
            history.append(_look(trainer, loss, before + spent))
            keeper.see(trainer, history[-1])
            cost = clock.spent() - spent
            schedule.look(trainer.step, spent, history[-1].get("heldout_psnr"))
            progress.advance(done, **history[-1])
        elif trainer.step % REPORT_EVERY == 0:
            progress.advance(done, loss=loss)
        if watch is not None:
            watch(trainer)
        if checkpoint is not None and time.perf_counter() - saved > CHECKPOINT_SECONDS:
            save_checkpoint(checkpoint, trainer.state(before + clock.spent(), history))
            saved = time.perf_counter()
    spent = clock.spent()
    end = time.perf_counter()
    if not history or history[-1]["step"] != trainer.step:
        history.append(_look(trainer, loss, before + spent))
    if checkpoint is not None:
        save_checkpoint(checkpoint, trainer.state(before + spent, history))
    if stopped == "cancelled" and keeper.better_than(history[-1]):
        progress.note(f"The twin is that of step {keeper.step}, the best on the photos held out")
        trainer.optimizer.gaussians = keeper.gaussians
    gaussians = trainer.result()
    behind = trainer.background.cpu()
    return Trained(
        gaussians=gaussians,
        low_pass=LOW_PASS_VARIANCE,
        background=(float(behind[0]), float(behind[1]), float(behind[2])),
        history=history,
        counters=trainer.counters(),
        seconds={
            "compile": compiled_at - start,
            "prepare": prepared - compiled_at,
            "train": before + spent,
            "finish": time.perf_counter() - end,
        },
        steps=trainer.step,
        stopped=stopped,
        settings=replace(settings),
    )


def _warn_of_blur(ratio: NoiseToSignal | None, progress: Progress) -> None:
    if ratio is not None and ratio.contradicted:
        progress.note(
            f"The photos hold {ratio.excess:.0f} times the fine detail that the blur, as it was given, could have let"
            f" through. It is narrower than given ({ratio.widest:.0%} of the width at most), or of another kind."
            " What contradicts it is not sharpened. Measure the blur (measure-psf), or let it be found (--psf auto)"
        )


class _Clock:
    """Seconds of work since it was made; waiting (a paused job) is none."""

    def __init__(self) -> None:
        self._began = time.perf_counter()

    def spent(self) -> float:
        return time.perf_counter() - self._began

    def waited(self, question: Callable[[], bool]) -> bool:
        asked = time.perf_counter()
        answer = question()
        self._began += time.perf_counter() - asked
        return answer


class _Best:
    """The twin of the look that predicted the held-out photos best."""

    def __init__(self) -> None:
        self.psnr, self.step = -math.inf, 0
        self.gaussians: Gaussians

    def see(self, trainer: Trainer, row: dict[str, float]) -> None:
        if row.get("heldout_psnr", -math.inf) > self.psnr:
            self.psnr, self.step = row["heldout_psnr"], trainer.step
            self.gaussians = trainer.optimizer.gaussians.detached()

    def better_than(self, row: dict[str, float]) -> bool:
        return self.psnr > row.get("heldout_psnr", math.inf) + BETTER_DB


def _look(trainer: Trainer, loss: float, seconds: float) -> dict[str, float]:
    """One row of the history."""
    row = {
        "step": trainer.step,
        "seconds": round(seconds, 3),
        "loss": loss,
        "gaussians": len(trainer.optimizer.gaussians),
    }
    psnr = trainer.heldout_psnr()
    return row if psnr is None else {**row, "heldout_psnr": psnr}
