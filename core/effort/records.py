"""What past runs on this machine took, in the user's cache folder: predictions are calibrated with them."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from ..errors import OutputError
from ..files import plain, read_json, write_json
from ..json_shape import anything, check_shape, count, text, truth
from ..json_shape import number as number_shape
from ..kernel_cache import cache_base
from ..numbers import number
from ..photos.load import Photo

#: Raised whenever this software becomes so much quicker or slower that older records mislead.
ERA = 2


@dataclass(frozen=True)
class RecordSettings:
    """What is remembered of past runs, and which of them count."""

    kept: int = number(200, "count", "runs, and predictions, that the file holds: it stays below 200 kB")
    disturbed_share: float = number(
        0.15, "share", "of the machine that other programs used, above which a run says nothing of the machine itself"
    )


RECORDS = RecordSettings()


@dataclass(frozen=True)
class Work:
    """What there is to do.

    Attributes:
        photos: how many; files_megapixels: of all files together.
        megapixels: of one photo as it is used.
        fitted, scored: photos trained on, and held-out views that are scored.
        steps, gaussians: of the training.
        search: whether cameras are to be found; hurried: in a hurry.
        points: whether points come with the cameras, found or given; a first surface is sought around them, or from
            nothing.
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
    points: bool

    def training(self, fitted: int, scored: int, steps: int, gaussians: int) -> Work:
        """The same with another training."""
        return replace(self, fitted=fitted, scored=scored, steps=steps, gaussians=gaussians)


def photo_work(photos: Sequence[Photo], *, search: bool, hurried: bool, compiled: bool, points: bool) -> Work:
    """What there is to do with these photos but for the training; see `Work`."""
    used = [photo.size[0] * photo.size[1] for photo in photos]
    files = [(w * h) / (p.scale[0] * p.scale[1]) for p, (w, h) in ((p, p.size) for p in photos)]
    mean = sum(used) / max(1, len(used)) / 1e6
    return Work(len(photos), sum(files) / 1e6, mean, 0, 0, 0, 0, search, hurried, compiled, points)


@dataclass(frozen=True)
class PastRun:
    """One finished run.

    Attributes:
        work: what was done.
        seconds: by stage (`model.STAGES`).
        train_predicted: seconds of training that the probe predicted, None without a probe.
        memory_mb: peak.
        scene: key of photos and medium, whatever the effort; preset: '' where it was none.
        contrast: of the photos (`model.contrast`).
        psnr, sharp_psnr: on held-out views, against the photos and against the truth.
        disturbed: share of the machine that others used; None where the system does not say.
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
        return self.disturbed is None or self.disturbed <= RECORDS.disturbed_share


def _amount(value: object) -> bool:
    """Number from 0."""
    return isinstance(value, (int, float)) and number_shape(value) and value >= 0


def _contrast(value: object) -> bool:
    """Number above 0."""
    return isinstance(value, (int, float)) and number_shape(value) and value > 0


#: How a run stands in the file.
_ROW = {
    "work": {
        **dict.fromkeys(("photos", "fitted", "scored", "steps", "gaussians"), count),
        **dict.fromkeys(("files_megapixels", "megapixels"), _amount),
        **dict.fromkeys(("search", "hurried", "compiled", "points"), truth),
    },
    "seconds": {"*": _amount},
    **dict.fromkeys(("train_predicted", "memory_mb", "disturbed"), (_amount,)),
    **dict.fromkeys(("scene", "preset"), text),
    "contrast": _contrast,
    **dict.fromkeys(("psnr", "sharp_psnr"), (number_shape,)),
}


class Records:
    """The file of this machine's runs.

    Args:
        machine: by processor, cores, threads and device, machines are distinguished.
        folder: the user's cache folder if not given.
    """

    def __init__(self, machine: dict[str, Any], folder: Path | None = None) -> None:
        identity = json.dumps({k: machine.get(k) for k in ("processor", "cores", "threads", "device")}, sort_keys=True)
        name = hashlib.sha256(f"{ERA} {identity}".encode()).hexdigest()[:12]
        self.path = (folder or cache_base()) / f"runs-{name}.json"
        self._machine = json.loads(identity)
        content = _read(self.path)
        self.runs = [run for row in content["runs"] if (run := _run(row)) is not None]
        self.predictions: dict[str, Any] = content["predictions"]

    def add(self, run: PastRun) -> None:
        """Keeps a run; a cache that cannot be written is no loss worth an error."""
        self.runs = [*self.runs, run][-RECORDS.kept :]
        self._save()

    def predict(self, key: str, prediction: dict[str, Any]) -> None:
        """Keeps what was predicted of a job, so that its report can say how true it was."""
        self.predictions.pop(key, None)
        self.predictions = dict([*self.predictions.items(), (key, prediction)][-RECORDS.kept :])
        self._save()

    def _save(self) -> None:
        runs = [asdict(run) for run in self.runs]
        with contextlib.suppress(OutputError):
            write_json(self.path, plain({"machine": self._machine, "runs": runs, "predictions": self.predictions}))


def _read(path: Path) -> dict[str, Any]:
    try:
        content = read_json(path)
        check_shape(content, {"runs": [anything], "predictions": {"*": anything}})
    except (OSError, ValueError):  # none yet, or cut off
        return {"runs": [], "predictions": {}}
    return dict(content)


def _run(row: Any) -> PastRun | None:
    """None for what another version wrote, or what was damaged."""
    try:
        check_shape(row, _ROW)
    except ValueError:
        return None
    if set(row) != {f.name for f in fields(PastRun)} or set(row["work"]) != {f.name for f in fields(Work)}:
        return None
    return PastRun(**{**row, "work": Work(**row["work"])})
