"""What of a run decides how long it takes and how good it gets: by this, past runs are found again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..formats.cameras import brings_points
from ..run_settings import RunSettings


@dataclass(frozen=True)
class RunDescription:
    """One run as predictions see it.

    Attributes:
        psf, blur_space, max_size, holdout_every: as in `core.run_settings`.
        preset, loss, max_gaussians, sh_degree: of the training.
        search: whether cameras are to be found; points: whether they are, or come with points of their own.
        effects: whether any besides the blur may be simulated, but for what an ordinary run looks for.
        trials: whether they are looked for and tried.
        until: whether the training ends at a quality; resume: whether it goes on from a checkpoint, or from
            cameras that were found before.
        time_limit: seconds in all, or None.
        memory: bytes that the run should hold at most, its photos on disk; None: photos in memory.
    """

    psf: str
    blur_space: str
    max_size: int | None
    holdout_every: int
    preset: str
    loss: Literal["dgs", "paper"]
    max_gaussians: int | None
    sh_degree: int | None
    search: bool
    points: bool
    effects: bool
    trials: bool
    until: bool
    resume: bool
    time_limit: float | None
    memory: int | None = None

    @staticmethod
    def of(run: RunSettings) -> RunDescription:
        """Read off a run's settings."""
        training, given = run.training, run.cameras.given
        return RunDescription(
            psf=run.medium.psf,
            blur_space=run.medium.blur_space,
            max_size=run.photos.max_size,
            holdout_every=run.photos.holdout_every,
            preset=training.preset,
            loss=training.loss,
            max_gaussians=training.max_gaussians,
            sh_degree=training.sh_degree,
            search=given is None,
            points=given is None or brings_points(given),
            effects=run.effects not in ("none", "usual") or run.glass is not None,
            trials=run.effects.split(",")[0].strip() == "auto",
            until=training.until is not None,
            resume=run.resume or run.keep_cameras,
            time_limit=run.time_limit,
            memory=run.photos.memory,
        )

    def scene_key(self, files: Sequence[Path]) -> str:
        """Of photos, their size and medium, whatever the effort; raises OSError where a file is gone."""
        facts = [[file.name, file.stat().st_size] for file in files]
        content = [facts, self.psf, self.blur_space, self.max_size]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:12]

    def job_key(self, scene: str, preset: str) -> str:
        """Of one job: a prediction belongs to it alone."""
        size = (self.max_gaussians, self.sh_degree, self.holdout_every)
        facts = [scene, preset, *size, self.search, self.points, self.loss]
        facts += [] if self.memory is None else [self.memory]
        facts += ["trials"] if self.trials else []
        return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:12]
