"""A whole training run: plan, progress, held-out accuracy, checkpoints, time limit, cancel."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, SupportsFloat

import torch

from .. import compiled
from ..constants import LOW_PASS_VARIANCE
from ..files import write_bytes
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.spectrum import NoiseToSignal
from ..numbers import BY_DEFINITION, number
from ..progress import Progress
from ..version import VERSION
from .cameras.moving import adjust_cameras
from .checkpoint import load_checkpoint, save_checkpoint
from .density.asking import ask_photos
from .job import TrainingJob
from .kept_state import checkpoint_of, counts_of, fingerprint_of, restore
from .origin import rank_difference
from .ranks import ALONE, RankLost, Ranks
from .restored.course import Part
from .schedule import Ending, Schedule
from .settings import TrainingSettings
from .trainer import Trainer
from .unseen import finish_unseen, heldout_psnr, judge_dropout, measure_kernels
from .warmup import compile_kernels

#: Why a run ended.
Stop = Ending | Literal["cancelled"]


@dataclass(frozen=True)
class TrainingRunSettings:
    """Numbers of a training run's course: when it is evaluated, kept and reported."""

    checkpoint_seconds: float = number(
        25.0,
        "s",
        "between two checkpoints; with an iteration and the writing, a killed run loses less than 30 s of work",
        BY_DEFINITION,
    )
    evaluations: int = number(
        16, "count", "of the held-out photos in a run, evenly over it; more cost time that iterations could have"
    )
    evaluations_until: int = number(
        40, "count", "the same in a run that waits for an accuracy, which it would overshoot"
    )
    least_iterating: float = number(
        0.2, "share", "of the time limit that iterations get, however long the preparation took"
    )
    clearly_better: float = number(
        0.05, "dB", "a stopped run leaves its best evaluated state instead of its last one if that was better by more"
    )
    report_every: int = number(10, "steps", "between two reports of progress; more often costs time, less often jerks")


RUN = TrainingRunSettings()


@dataclass
class Trained:
    """What `train` gives back.

    Attributes:
        gaussians: in the world of the cameras that came in, to be drawn with the usual low-pass.
        low_pass: variance (px^2) to draw them with.
        background: [3] sRGB colour behind them.
        history: one row per evaluation: step, seconds, loss, gaussians and, if photos are held out,
            heldout_psnr (dB, degraded render against photo); restored is 1 where new Gaussians were being fitted to
            restored photos.
        counters: what was added, removed, refused and repaired.
        seconds: 'prepare', 'compile', 'train', 'finish'.
        steps: iterations done.
        stopped: 'done', 'time limit', 'quality', 'plateau' or 'cancelled'.
        settings: what was used.
        formation: the effects, with what was learned of them.
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
    formation: Formation = Formation()


def train(
    job: TrainingJob,
    progress: Progress,
    checkpoint: Path | None = None,
    resume: bool = False,
    watch: Callable[[Trainer], None] | None = None,
    ranks: Ranks = ALONE,
) -> Trained:
    """Optimizes Gaussians against photos through the medium.

    Args:
        job: photos, points, medium and settings.
        checkpoint: file that the state is kept in; None for none.
        resume: go on from `checkpoint` if it is there.
        watch: called after every iteration; may look, and must not change anything.
        ranks: processes that train together; rank 0 has the checkpoint, and all go on from it.

    Raises:
        TrainingError: a rank has other photos, settings or another version. RankLost: one died; rank 0's checkpoint
            holds the state before.
        CheckpointError: the checkpoint is damaged or belongs to another run.
        NonFiniteParameter: the optimization diverged beyond repair.
        OutputError: the checkpoint cannot be written.
    """
    settings = job.settings
    if settings.threads:
        compiled.set_threads(settings.threads)
        torch.set_num_threads(settings.threads)
    start = time.perf_counter()
    progress.stage("compile")
    compile_kernels(settings.sh_degree)
    compiled_at = time.perf_counter()
    trainer = _agreed_trainer(job, ranks)
    _warn_of_blur(trainer.levels[-1].ratio, progress)
    run = _Run(trainer, settings, progress, checkpoint, job.evaluated)
    if resume:
        run.resume()
    prepared = time.perf_counter()
    progress.stage("train", settings.steps)
    stopped = run.iterate(_limit(settings.time_limit, prepared - start), watch)
    end = time.perf_counter()
    gaussians = run.finished(stopped)
    if not ranks.alone:
        progress.note(f"{ranks.count} ranks; {run.traffic() / 1e6:.2f} MB each way for each of them in a step")
    finish_unseen(trainer)
    measure_kernels(trainer)
    behind = trainer.background.cpu()
    return Trained(
        gaussians=gaussians,
        low_pass=LOW_PASS_VARIANCE,
        background=(float(behind[0]), float(behind[1]), float(behind[2])),
        history=run.history,
        counters=counts_of(trainer),
        seconds={
            "compile": compiled_at - start,
            "prepare": prepared - compiled_at,
            "train": run.seconds,
            "finish": time.perf_counter() - end,
        },
        steps=trainer.step,
        stopped=stopped,
        settings=replace(settings),
        formation=trainer.learned.chain(),
    )


def _agreed_trainer(job: TrainingJob, ranks: Ranks) -> Trainer:
    """The trainer of a job, which all ranks train alike.

    Raises:
        TrainingError: a rank has other photos, settings or another version.
    """
    trainer = Trainer(job.views, job.heldout, job.points, job.medium, job.settings, job.formation)
    trainer.adjust, trainer.restore = job.adjust, job.restore
    agreed = {name: value for name, value in asdict(job.settings).items() if name not in ("threads", "device")}
    ranks.agree({"version": VERSION, **fingerprint_of(trainer), "settings": agreed}, rank_difference)
    trainer.join(ranks)
    return trainer


def _limit(asked: float | None, preparation: float) -> float | None:
    """Seconds that are left for iterations; None for no limit."""
    return None if asked is None else max(asked - preparation, RUN.least_iterating * asked)


class _Run:
    """The iterations of one training: its steps, evaluations, checkpoints and end.

    Args:
        settings: as they were asked for (the trainer's own follow the number of photos).
        checkpoint: file that the state is kept in; None for none.
        evaluated: whether held-out photos are looked at.

    Attributes:
        history: one row per evaluation, those before a resumption included.
        seconds: of training, those before a resumption included.
    """

    def __init__(
        self,
        trainer: Trainer,
        settings: TrainingSettings,
        progress: Progress,
        checkpoint: Path | None,
        evaluated: bool = True,
    ) -> None:
        self.trainer, self.settings, self.progress, self.checkpoint = trainer, settings, progress, checkpoint
        self.history: list[dict[str, float]] = []
        self.seconds = 0.0
        self._earlier = 0.0  # seconds of the run that is resumed
        self._loss: SupportsFloat = 0.0
        self._best = _Best()
        self._evaluations = RUN.evaluations if settings.until is None else RUN.evaluations_until
        if not evaluated:
            self._evaluations = 0
        self._evaluated = 0  # evaluations that were due so far
        self._evaluation_seconds = 0.0  # of the last one

    def resume(self) -> None:
        """Goes on from the checkpoint, if there is one; rank 0's is everybody's."""
        ranks = self.trainer.ranks
        if self.checkpoint is None:
            return
        if not ranks.alone:
            own = self.checkpoint.read_bytes() if ranks.rank == 0 and self.checkpoint.exists() else None
            kept = ranks.bytes_of_first(own)
            if kept is not None and ranks.rank:
                write_bytes(self.checkpoint, kept)
        if not self.checkpoint.exists():
            return
        state = load_checkpoint(self.checkpoint, fingerprint_of(self.trainer))
        restore(self.trainer, state)
        self.history, self._earlier = state.history, state.seconds
        self.progress.note(f"Going on from step {state.step}")

    def iterate(self, limit: float | None, watch: Callable[[Trainer], None] | None) -> Stop:
        """Steps until the end; why it came. `limit`: seconds, None for none."""
        clock = _Clock()
        try:
            stopped = self._iterate(limit, watch, clock)
        except RankLost:  # what was reached is kept first
            if self._keeps:
                self._save(clock.spent())
            raise
        self.seconds = self._earlier + clock.spent()
        return stopped

    def _iterate(self, limit: float | None, watch: Callable[[Trainer], None] | None, clock: _Clock) -> Stop:
        trainer = self.trainer
        schedule = Schedule(self.settings, limit, trainer.step)
        self._evaluated = self._due(schedule.share(trainer.step, 0.0))
        saved = time.perf_counter()
        stopped: Stop = "cancelled"
        while not trainer.ranks.any(clock.waited(self.progress.cancelled)):
            spent = clock.spent()
            # The last evaluation takes as long as the one before, and belongs to the run.
            ending = schedule.ended(trainer.step, spent if limit is None else spent + self._evaluation_seconds)
            if ending is not None:
                stopped = ending
                break
            share = min(schedule.share(trainer.step, spent), 1.0 - 1e-9)
            part = self._entered(share)
            self._loss = trainer.advance(share)
            ask_photos(trainer, part.share)
            adjust_cameras(trainer, part.share, self.progress.cancelled)
            self._report(schedule, clock, limited=limit is not None)
            if watch is not None:
                watch(trainer)
            if self._keeps and time.perf_counter() - saved > RUN.checkpoint_seconds:
                self._save(clock.spent())
                saved = time.perf_counter()
        return stopped

    def _entered(self, share: float) -> Part:
        """The part of the run at a share of it; a word where new Gaussians are to take the place of all."""
        part = self.trainer.part(share)
        if part.restored and self.trainer.restored_around is None:
            self.progress.note(
                "The photos' paths are known: each photo is restored around the twin so far, and new Gaussians are"
                " fitted to what comes of it (the twin looks rough for a while)"
            )
        return part

    @property
    def _keeps(self) -> bool:
        """Whether this process writes checkpoints."""
        return self.checkpoint is not None and self.trainer.ranks.rank == 0

    def traffic(self) -> float:
        """Bytes that each rank sent, and took, in a step."""
        ranks = self.trainer.ranks
        return ranks.sent / max(1, -(-self.trainer.step // ranks.count))

    def finished(self, stopped: Stop) -> Gaussians:
        """Evaluates and keeps the last state; the twin, of the best state if the run was cancelled."""
        if self._evaluations and (not self.history or self.history[-1]["step"] != self.trainer.step):
            self.history.append(_evaluation(self.trainer, float(self._loss), self.seconds))
        if self._keeps and self.checkpoint is not None:
            save_checkpoint(self.checkpoint, checkpoint_of(self.trainer, self.seconds, self.history))
        if stopped == "cancelled" and self.history and self._best.better_than(self.history[-1]):
            self.progress.note(f"The twin is that of step {self._best.step}, the best on the photos held out")
            self.trainer.optimizer.gaussians = self._best.gaussians
        return self.trainer.result()

    def _due(self, share: float) -> int:
        """How many evaluations belong to this share of the run."""
        return int(share * self._evaluations + 1e-9)

    def _report(self, schedule: Schedule, clock: _Clock, limited: bool) -> None:
        """Reports a step, and evaluates the twin where that is due."""
        trainer, steps = self.trainer, self.settings.steps
        spent = clock.spent()
        share = schedule.share(trainer.step, spent)
        done = min(round(share * steps), steps) if limited else trainer.step
        if self._due(share) > self._evaluated:
            self._evaluated = self._due(share)
            row = _evaluation(trainer, float(self._loss), self._earlier + spent)
            self.history.append({**row, "restored": 1.0} if trainer.part(share).restored else row)
            self._best.see(trainer, row)
            self._evaluation_seconds = clock.spent() - spent
            scores = [score for one in self.history if (score := one.get("heldout_psnr")) is not None]
            if judge_dropout(trainer, share, scores):
                self.progress.note(
                    "Photos that are held out get worse, and are worse than those that are fitted: from step"
                    f" {trainer.step} on a random part of the Gaussians is left out of each step"
                )
            schedule.evaluated(trainer.step, spent, row.get("heldout_psnr"))
            self.progress.advance(done, **row)
        elif trainer.step % RUN.report_every == 0:
            self.progress.advance(done, loss=float(self._loss))

    def _save(self, spent: float) -> None:
        assert self.checkpoint is not None
        save_checkpoint(self.checkpoint, checkpoint_of(self.trainer, self._earlier + spent, self.history))


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
    """The evaluated twin that predicted the held-out photos best."""

    def __init__(self) -> None:
        self.psnr, self.step = -math.inf, 0
        self.gaussians: Gaussians

    def see(self, trainer: Trainer, row: dict[str, float]) -> None:
        if row.get("heldout_psnr", -math.inf) > self.psnr:
            self.psnr, self.step = row["heldout_psnr"], trainer.step
            self.gaussians = trainer.optimizer.gaussians.detached()

    def better_than(self, row: dict[str, float]) -> bool:
        return self.psnr > row.get("heldout_psnr", math.inf) + RUN.clearly_better


def _evaluation(trainer: Trainer, loss: float, seconds: float) -> dict[str, float]:
    """One row of the history."""
    row = {
        "step": trainer.step,
        "seconds": round(seconds, 3),
        "loss": loss,
        "gaussians": len(trainer.optimizer.gaussians),
    }
    psnr = heldout_psnr(trainer)
    return row if psnr is None else {**row, "heldout_psnr": psnr}
