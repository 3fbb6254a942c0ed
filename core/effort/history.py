"""A run joins the records of its machine, and hears what was predicted of it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..photos.load import Photo
from .clock import OthersLoad
from .estimate import job_key, scene_key
from .model import contrast
from .plan import Budget, work_of
from .records import Records, Run

if TYPE_CHECKING:
    from ..run_settings import ReconstructSettings


class History:
    """What is known of one run besides its results.

    Args:
        machine: that it runs on.
        compiled: whether the kernels lay compiled in the cache when it began.
    """

    def __init__(self, settings: ReconstructSettings, machine: dict[str, Any], compiled: bool) -> None:
        self.settings, self.compiled = settings, compiled
        self.records = Records(machine)
        self.others = OthersLoad()

    def predicted(self, photos: Sequence[Photo], budget: Budget | None) -> dict[str, Any] | None:
        """What was said before: by the plan of a time limit, or by `estimate` of these photos; None if nothing was."""
        if budget is not None:
            plan = budget.plan
            return None if plan is None else {"by": "plan", "seconds": plan.limit, **plan.plain()}
        told = self.records.predictions.get(self._key(photos))
        if not isinstance(told, dict):
            return None
        return {
            "by": "estimate",
            "seconds": told["seconds"]["value"],
            "low": told["seconds"]["low"],
            "high": told["seconds"]["high"],
            "memory_mb": told["memory_mb"]["value"],
            "psnr": told["psnr"],
            "stages": told["stages"],
        }

    def keep(
        self, report: dict[str, Any], photos: Sequence[Photo], fitted: int, budget: Budget | None, page: float
    ) -> None:
        """Adds a finished run; one that was resumed, stopped or tried effects is like no other and is left out.

        `page`: seconds that writing the report itself took.
        """
        s = self.settings
        planned = budget is not None
        if s.resume or report["status"] not in ("done", "time limit") or s.effects != "none":
            return
        held = report["heldout"]
        hurried = s.preset == "draft" or (budget is not None and budget.hurried)
        work = work_of(
            photos,
            fitted,
            len(held["names"]),
            report["steps"],
            report["gaussians"],
            s.cameras is None,
            hurried,
            self.compiled,
        )
        taken = {**report["seconds"], "page": page}
        seconds = {name: value for name, value in taken.items() if value is not None and name != "total"}
        self.records.add(
            Run(
                work=work,
                seconds=seconds,
                train_predicted=self._probed(photos, report, budget),
                memory_mb=report["peak_memory_mb"],
                scene=self._scene(photos),
                contrast=contrast(photos),
                preset="" if planned or s.until is not None else s.preset,
                psnr=held["degraded"]["psnr"],
                sharp_psnr=held["sharp"]["psnr"],
                disturbed=self.others.share(),
            )
        )

    def _probed(self, photos: Sequence[Photo], report: dict[str, Any], budget: Budget | None) -> float | None:
        """Seconds of training that a probe had told for the steps that were done."""
        if budget is not None:
            return None if budget.speed is None else budget.speed.training(report["steps"], report["gaussians"])
        told = self.records.predictions.get(self._key(photos))
        return float(told["train_probed"]) if isinstance(told, dict) and told.get("steps") == report["steps"] else None

    def _scene(self, photos: Sequence[Photo]) -> str:
        with contextlib.suppress(OSError):
            return scene_key(self.settings, _files(photos))
        return ""

    def _key(self, photos: Sequence[Photo]) -> str:
        return job_key(self.settings, self._scene(photos), self.settings.preset)


def _files(photos: Sequence[Photo]) -> list[Path]:
    return [photo.path for photo in photos]
