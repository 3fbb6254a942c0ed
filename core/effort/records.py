"""What past runs on this machine took, in the user's cache folder: predictions are calibrated with them."""

from __future__ import annotations

import contextlib
import hashlib
import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..compiled import cache_base
from ..errors import OutputError
from ..files import write_json

#: Runs and predictions that are kept.
KEPT = 200
#: Raised whenever this software becomes so much quicker or slower that older records mislead.
ERA = 2
#: Runs during which others used more of the machine than this do not calibrate.
DISTURBED = 0.15


@dataclass(frozen=True)
class Work:
    """What there is to do.

    Attributes:
        photos: how many; files_megapixels: of all files together.
        megapixels: of one photo as it is used.
        fitted, scored: photos trained on, and held-out views that are scored.
        steps, gaussians: of the training.
        search: whether cameras are to be found; hurried: in a hurry.
        compiled: whether the kernels lie compiled in the cache.
    """

    photos: int
    files_megapixels: float
    megapixels: float
    fitted: int
    scored: int
    steps: int
    gaussians: int
    search: bool
    hurried: bool
    compiled: bool


@dataclass(frozen=True)
class Run:
    """One finished run.

    Attributes:
        work: what was done.
        seconds: by stage (`model.STAGES`).
        train_predicted: seconds of training as the probe had told, None without a probe.
        memory_mb: peak.
        scene: of photos and medium, whatever the effort; preset: '' where it was none.
        contrast: of the photos (`model.contrast`).
        psnr, sharp_psnr: on held-out views, against the photos and against the truth.
        disturbed: share of the machine that others used; None where not known.
    """

    work: Work
    seconds: dict[str, float]
    train_predicted: float | None
    memory_mb: float | None
    scene: str
    preset: str
    contrast: float
    psnr: float | None
    sharp_psnr: float | None
    disturbed: float | None

    @property
    def clean(self) -> bool:
        """Whether its seconds are the machine's own."""
        return self.disturbed is None or self.disturbed <= DISTURBED


class Records:
    """The file of this machine's runs.

    Args:
        machine: what tells machines apart: processor, cores, threads, device.
        folder: the user's cache folder if not given.
    """

    def __init__(self, machine: dict[str, Any], folder: Path | None = None) -> None:
        told = json.dumps({k: machine.get(k) for k in ("processor", "cores", "threads", "device")}, sort_keys=True)
        name = hashlib.sha256(f"{ERA} {told}".encode()).hexdigest()[:12]
        self._path = (folder or cache_base()) / f"runs-{name}.json"
        self._told = json.loads(told)
        content = _read(self._path)
        self.runs = [run for row in content.get("runs", []) if (run := _run(row)) is not None]
        self.predictions: dict[str, Any] = dict(content.get("predictions", {}))

    def add(self, run: Run) -> None:
        """Keeps a run; a cache that cannot be written is no loss worth an error."""
        self.runs = [*self.runs, run][-KEPT:]
        self._save()

    def predict(self, key: str, prediction: dict[str, Any]) -> None:
        """Keeps what was predicted of a job, so that its report can say how true it was."""
        self.predictions.pop(key, None)
        self.predictions = dict([*self.predictions.items(), (key, prediction)][-KEPT:])
        self._save()

    def _save(self) -> None:
        runs = [asdict(run) for run in self.runs]
        with contextlib.suppress(OutputError):
            write_json(self._path, {"machine": self._told, "runs": runs, "predictions": self.predictions})


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):  # none yet, or cut off
        return {}
    return content if isinstance(content, dict) else {}


def _run(row: Any) -> Run | None:
    """None for what another version wrote."""
    try:
        run = Run(**{**row, "work": Work(**row["work"])})
    except (TypeError, KeyError):
        return None
    return run if set(row) == {f.name for f in fields(Run)} else None
