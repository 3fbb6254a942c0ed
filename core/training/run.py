"""A whole training run: plan, progress, held-out accuracy, checkpoints, time limit, cancel."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from .. import compiled
from ..constants import LOW_PASS_VARIANCE
from ..gaussians import Gaussians
from ..imaging.medium import Medium
from ..progress import Progress
from ..views import SparsePoints, View
from .checkpoint import load_checkpoint, save_checkpoint
from .settings import TrainingSettings
from .trainer import Trainer
from .warmup import compile_kernels

#: Seconds between two checkpoints. With an iteration and the writing, a kill loses less than 30 s of the optimization.
CHECKPOINT_SECONDS = 25.0
#: How often the held-out photos are looked at during a run.
LOOKS = 16
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
        seconds: 'prepare', 'compile', 'train'.
        steps: iterations done.
        stopped: 'done', 'time limit' or 'cancelled'.
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


def train(views: Sequence[View], heldout: Sequence[View], points: SparsePoints, medium: Medium,
          settings: TrainingSettings, progress: Progress, checkpoint: Path | None = None,
          resume: bool = False, watch: Callable[[Trainer], None] | None = None) -> Trained:  # fmt: skip
    """Optimizes Gaussians against photos through the medium.

    Args:
        views: photos to fit, with cameras in any world.
        heldout: photos to watch only; never fitted.
        points: sparse points in the same world.
        checkpoint: file that the state is kept in; None for none.
        resume: go on from `checkpoint` if it is there.
        watch: called after every iteration; may look, and must not change anything.

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
    trainer = Trainer(views, heldout, points, medium, settings)
    history: list[dict[str, float]] = []
    before = 0.0
    if resume and checkpoint is not None and checkpoint.exists():
        state = load_checkpoint(checkpoint, trainer.fingerprint())
        trainer.restore(state)
        history, before = state.history, state.seconds
        progress.note(f"Going on from step {state.step}")
    prepared = time.perf_counter()
    progress.stage("train", settings.steps)
    limit = None if settings.time_limit is None else max(0.0, settings.time_limit - (prepared - start))
    stopped, saved, loss = "done", prepared, 0.0
    looks = {round(settings.steps * (i + 1) / LOOKS) for i in range(LOOKS)}
    while trainer.step < settings.steps:
        spent = time.perf_counter() - prepared
        if progress.cancelled():
            stopped = "cancelled"
            break
        if limit is not None and spent >= limit:
            stopped = "time limit"
            break
        share = trainer.step / settings.steps
        loss = trainer.advance(share if limit is None else max(share, spent / limit))
        if trainer.step in looks or trainer.step == settings.steps:
            history.append(_look(trainer, loss, before + time.perf_counter() - prepared))
            progress.advance(trainer.step, **history[-1])
        elif trainer.step % REPORT_EVERY == 0:
            progress.advance(trainer.step, loss=loss)
        if watch is not None:
            watch(trainer)
        if checkpoint is not None and time.perf_counter() - saved > CHECKPOINT_SECONDS:
            save_checkpoint(checkpoint, trainer.state(before + time.perf_counter() - prepared, history))
            saved = time.perf_counter()
    end = time.perf_counter()
    if not history or history[-1]["step"] != trainer.step:
        history.append(_look(trainer, loss, before + end - prepared))
    if checkpoint is not None:
        save_checkpoint(checkpoint, trainer.state(before + end - prepared, history))
    behind = trainer.background.cpu()
    return Trained(
        gaussians=trainer.result(), low_pass=LOW_PASS_VARIANCE,
        background=(float(behind[0]), float(behind[1]), float(behind[2])), history=history, counters=trainer.counters(),
        seconds={"compile": compiled_at - start, "prepare": prepared - compiled_at, "train": before + end - prepared},
        steps=trainer.step, stopped=stopped, settings=replace(settings),
    )  # fmt: skip


def _look(trainer: Trainer, loss: float, seconds: float) -> dict[str, float]:
    """One row of the history."""
    row = {"step": trainer.step, "seconds": round(seconds, 3), "loss": loss,
           "gaussians": len(trainer.optimizer.gaussians)}  # fmt: skip
    psnr = trainer.heldout_psnr()
    return row if psnr is None else {**row, "heldout_psnr": psnr}
