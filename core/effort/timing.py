"""The time of one run: planned where there is a limit, compared with what was predicted, and remembered.

Made for `pipeline.timing.Timing`: a run is handed one and asks it; this package imports no pipeline.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..machine import Machine
from ..photos.load import Photo
from ..training.job import PlannedTraining, TrainingJob
from .clock import OthersLoad
from .described import RunDescription
from .estimate import kernels_compiled
from .model import contrast
from .plan import Budget
from .records import PastRun, Records, photo_work


class RunTiming:
    """What is known of a run's time.

    Args:
        run: what of it decides how long it takes.
        machine: that it runs on, whose past runs are looked up.
        spent: seconds that the run has worked so far.
    """

    def __init__(self, run: RunDescription, machine: Machine, spent: Callable[[], float]) -> None:
        self._run, self._compiled = run, kernels_compiled()
        self.records = Records(machine.facts)
        self._others = OthersLoad()
        self.budget = None
        if run.time_limit is not None:
            self.budget = Budget(run.time_limit, spent, self.records.runs, self._others.share, run)

    @property
    def limited(self) -> bool:
        """Whether there is a time limit."""
        return self.budget is not None

    def hurry(self, photos: Sequence[Photo]) -> bool:
        """Whether the cameras must be found in a hurry."""
        return self.budget is not None and self.budget.hurry(photos)

    def plan(
        self, job: TrainingJob, photos: Sequence[Photo], fixed: int | None, earlier: Mapping[str, Any] | None
    ) -> PlannedTraining:
        """The training that fits into what is left; see `Budget.train`."""
        return PlannedTraining(job.settings) if self.budget is None else self.budget.train(job, photos, fixed, earlier)

    def for_trials(self) -> Callable[[], float]:
        """Seconds that are left to trials of effects, from now on asked each time; infinite without a limit."""
        return (lambda: math.inf) if self.budget is None else self.budget.for_trials()

    def another(self) -> bool:
        """Whether there is time to score one more view."""
        return self.budget is None or self.budget.another()

    def overrun(self) -> float:
        """Seconds by which the time limit was passed; 0 where it was kept as well as is promised."""
        return 0.0 if self.budget is None else self.budget.overrun()

    def predicted(self, photos: Sequence[Photo]) -> dict[str, Any] | None:
        """What was said before: by the plan of a time limit, or by `estimate` of these photos; None if nothing was."""
        if self.budget is not None:
            plan = self.budget.plan
            return None if plan is None else {"by": "plan", "seconds": plan.limit, **plan.plain()}
        said = self.records.predictions.get(self._key(photos))
        if not isinstance(said, dict):
            return None
        return {
            "by": "estimate",
            "seconds": said["seconds"]["value"],
            "low": said["seconds"]["low"],
            "high": said["seconds"]["high"],
            "memory_mb": said["memory_mb"]["value"],
            "psnr": said["psnr"],
            "stages": said["stages"],
        }

    def keep(self, report: Mapping[str, Any], photos: Sequence[Photo], fitted: int, page: float) -> None:
        """Adds a finished run; one that was resumed or stopped is like no other and is left out.

        Of one that tried effects only the trials are kept: its training is like no other.

        Args:
            report: content of report.json; fitted: photos that were trained on.
            page: seconds that writing the report itself took.
        """
        run = self._run
        if run.resume or report["status"] not in ("done", "time limit"):
            return
        if run.trials:
            self.records.add(self._past(report, photos, fitted, {"trials": report["seconds"]["effects"]}))
        if run.effects or any(effect["on"] for effect in report["effects"]):
            return
        taken = {**report["seconds"], "page": page}
        seconds = {name: value for name, value in taken.items() if value is not None and name != "total"}
        held = report["heldout"]
        self.records.add(
            replace(
                self._past(report, photos, fitted, seconds),
                train_predicted=self._probed(photos, report),
                memory_mb=None if run.memory is not None else report["peak_memory_mb"],
                preset="" if self.budget is not None or run.until else run.preset,
                psnr=held["degraded"]["psnr"],
                sharp_psnr=held["sharp"]["psnr"],
            )
        )

    def _past(
        self, report: Mapping[str, Any], photos: Sequence[Photo], fitted: int, seconds: dict[str, float]
    ) -> PastRun:
        """The stages' seconds of a finished run, and nothing of its training."""
        run, budget = self._run, self.budget
        hurried = run.preset == "draft" or (budget is not None and budget.hurried)
        todo = photo_work(photos, search=run.search, hurried=hurried, compiled=self._compiled, points=run.points)
        return PastRun(
            work=todo.training(fitted, len(report["heldout"]["names"]), report["steps"], report["gaussians"]),
            seconds=seconds,
            train_predicted=None,
            memory_mb=None,
            scene=self._scene(photos),
            contrast=contrast(photos),
            preset="",
            psnr=None,
            sharp_psnr=None,
            disturbed=self._others.share(),
        )

    def _probed(self, photos: Sequence[Photo], report: Mapping[str, Any]) -> float | None:
        """Seconds of training that a probe predicted for the steps that were done."""
        if self.budget is not None:
            speed = self.budget.speed
            return None if speed is None else speed.training(report["steps"], report["gaussians"])
        said = self.records.predictions.get(self._key(photos))
        return float(said["train_probed"]) if isinstance(said, dict) and said.get("steps") == report["steps"] else None

    def _scene(self, photos: Sequence[Photo]) -> str:
        with contextlib.suppress(OSError):
            return self._run.scene_key([photo.path for photo in photos])
        return ""

    def _key(self, photos: Sequence[Photo]) -> str:
        return self._run.job_key(self._scene(photos), self._run.preset)
