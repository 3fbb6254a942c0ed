"""Where each step of the panel stands, read from the scene's settings and the results' folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core.errors import DgsError
from ...core.files import read_json
from ...core.json_shape import check_shape, count, number, sentence, text
from ..paths import absolute, out_folder
from ..photos import photo_folder
from .record import Record, read_record


@dataclass(frozen=True)
class ResultsFolder:
    """What a results' folder holds.

    Attributes:
        record: of the last job, or None.
        cameras, twin: whether they are there.
        report: content of report.json, {} if there is none.
        odd_report: whether there is one that is damaged or of another version.
    """

    record: Record | None = None
    cameras: bool = False
    twin: bool = False
    report: dict[str, Any] = field(default_factory=dict)
    odd_report: bool = False


_SCORE = {"psnr": (number,)}
#: What the panel shows of report.json.
_REPORT = {
    "photos": {"registered": count, "given": count},
    "gaussians": count,
    "resolvable_period_px": number,
    "verdict?": {"level": text, "sentence": sentence, "help": [sentence]},
    "heldout": {
        "names": [text],
        "degraded": _SCORE,
        "sharp": _SCORE,
        "bands?": ([{"finest": number, "coarsest": number, "correlation": (number,)}],),
    },
}
_NOTHING = ResultsFolder()
_cache: tuple[object, ResultsFolder] | None = None


def results(scene: Any) -> ResultsFolder:
    """What the scene's results' folder holds; read again only when its files change."""
    global _cache
    out = out_folder(scene.dgs)
    if out is None:
        return _NOTHING
    files = (out / "job.json", out / "report.json", out / "twin.ply", out / "cameras")
    key = (out, tuple(_changed(path) for path in files))
    if _cache is None or _cache[0] != key:
        _cache = (key, _read(out))
    return _cache[1]


def cameras_found(scene: Any) -> bool:
    """Whether the results hold cameras that were found from these photos, so that they can be used again."""
    settings = scene.dgs
    held = results(scene)
    if settings.cameras != "photos" or not held.cameras or held.record is None:
        return False
    photos, options = absolute(settings.photos), held.record.options
    return (
        "cameras" not in options
        and photos is not None
        and held.record.photos == str(photos)
        and held.record.selection == settings.selection
        and held.record.count == len(photo_folder(photos, settings.selection).files)
        and options.get("frames", settings.frames) == settings.frames
        and options.get("max_size", 0) == settings.max_size
    )


def _read(out: Path) -> ResultsFolder:
    try:
        record = read_record(out)
    except DgsError:
        record = None
    report, odd = {}, False
    try:
        content = read_json(out / "report.json")
        check_shape(content, _REPORT)
        report = content
    except OSError:
        pass
    except ValueError:
        odd = True
    return ResultsFolder(record, (out / "cameras").is_dir(), (out / "twin.ply").is_file(), report, odd)


def _changed(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None
