"""`batch`: several sets of photos, one twin each."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.effects.choices import effects_help
from ..core.errors import Cancelled, DgsError, PhotoError
from ..core.files import check_writable, read_json
from ..core.json_shape import check_shape, count, number, text
from ..core.names import check_given, shown
from .arguments import (
    CAMERAS,
    add_background,
    add_machine,
    add_max_size,
    add_medium,
    add_overwrite,
    add_progress,
    duration,
    show_defaults,
    whole,
)
from .child_run import Ended, run_child, was_stopped
from .progress_choice import Reporting
from .workers import Task, Workers, add_workers, chosen

#: Options that every run gets as they were given.
_PASSED = (
    *("psf", "blur_space", "effects", "cameras", "background", "max_size", "holdout_every", "preset", "time_limit"),
    *("max_gaussians", "sh_degree", "seed", "adjust_cameras", "refine_cameras", "device", "threads", "overwrite"),
)
#: What is read of the report of a twin.
_REPORT = {
    "status": text,
    "gaussians": count,
    "photos": {"registered": count, "given": count},
    "heldout": {"degraded": {"psnr?": (number,)}},
    "seconds": {"total": number},
}
#: Characters of a folder's name in the table.
_WIDTH = 32


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        photos, out: what was read, and where its results are.
        how: 'done', 'done before', 'stopped', 'failed' or 'not begun'.
        why: the reason where it failed.
        registered, psnr, gaussians, seconds: of the twin's report; '' or None where there is none.
    """

    photos: str
    out: str
    how: str
    why: str = ""
    registered: str = ""
    psnr: float | None = None
    gaussians: int | None = None
    seconds: float | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Makes a twin of each set of photos, each in a process of its own: one that fails stops no other. Asked again, "
        "it goes on where it was stopped."
    )
    show_defaults(parser)
    add = parser.add_argument
    add(
        "photos",
        type=Path,
        nargs="+",
        metavar="PHOTOS",
        help="folders of photos, lists of them (.txt) or movies; one twin each",
    )
    add("--out", type=Path, metavar="DIR", help="folder for the twins; beside each set of photos if not given")
    add("--again", action="store_true", help="make twins anew that are finished")
    add_overwrite(parser)
    add_medium(parser)
    add("--effects", default="usual", metavar="EFFECTS", help=effects_help())
    add("--cameras", type=Path, metavar="MODEL", help=f"given for the photos of all sets: {CAMERAS}")
    add_background(parser)
    add_max_size(parser)
    add("--holdout-every", type=whole(0), default=8, metavar="N", help="keep every Nth view out of the training")
    add("--preset", choices=("draft", "balanced", "fine", "best"), default="balanced", help="how much time to spend")
    add("--time-limit", type=duration, metavar="TIME", help="for each twin, such as 120s or 2m")
    add("--max-gaussians", type=whole(100), metavar="N", help="the preset's if not given")
    add("--sh-degree", type=whole(0, 3), metavar="D", help="spherical harmonics; the preset's if not given")
    add("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N", help="same seed, same twins (CPU)")
    add(
        "--adjust-cameras",
        choices=("auto", "never", "always"),
        default="auto",
        help="where photos were shaken, move them",
    )
    add("--refine-cameras", action="store_true", help="move cameras by the loss before the training")
    add_machine(parser)
    add_workers(parser, "twins made")
    add_progress(parser)


def batch_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Makes all twins and prints a table; 2 if one failed, 130 if it was stopped."""
    for path in options.photos:
        check_given(path)
    outs = [result_folder(path, options.out) for path in options.photos]
    twice = next((out for number, out in enumerate(outs) if out in outs[:number]), None)
    if twice is not None:
        raise DgsError(f"Two sets of photos would have the same results' folder '{shown(twice)}'", "Rename one of them")
    began, workers = time.perf_counter(), chosen(options)
    sets = list(zip(options.photos, outs, strict=True))
    lines = _in_turn(sets, options, progress) if workers is None else _side_by_side(sets, workers, options, progress)
    if options.progress != "json":
        print("\n".join(table(lines)), flush=True)
    good = sum(line.how.startswith("done") for line in lines)
    said: dict[str, object] = {"twins": f"{good} of {len(lines)}", "seconds": round(time.perf_counter() - began, 1)}
    if options.progress == "json":
        said["sets"] = [asdict(line) for line in lines]
    progress.finished(said)
    if progress.cancelled():
        raise Cancelled("Stopped; finished twins and checkpoints are kept", "Ask the same again to go on")
    failed = [line for line in lines if line.how == "failed"]
    if failed:
        raise DgsError(f"{len(failed)} of {len(lines)} failed, the first for this: {failed[0].why}")
    return 0


def result_folder(photos: Path, parent: Path | None) -> Path:
    """Where a set's results go: NAME-twin beside the photos, as in Blender, or in `parent`."""
    place = photos.absolute()
    name = place.stem if place.is_file() else place.name
    return (parent if parent is not None else place.parent) / f"{name or 'photos'}-twin"


def table(lines: list[Line]) -> list[str]:
    """The lines of the table for a terminal, with its head."""
    shown_lines = [f"{'photos':<{_WIDTH}} {'':<12} {'cameras':>9} {'PSNR':>7} {'splats':>9} {'seconds':>8}"]
    for line in lines:
        name = Path(line.photos).name or line.photos
        psnr = "" if line.psnr is None else f"{line.psnr:.2f}"
        splats = "" if line.gaussians is None else f"{line.gaussians:,}"
        seconds = "" if line.seconds is None else f"{line.seconds:.0f}"
        cells = f"{line.how:<12} {line.registered:>9} {psnr:>7} {splats:>9} {seconds:>8}"
        shown_lines.append(f"{shown(name)[:_WIDTH]:<{_WIDTH}} {cells}  {line.why}".rstrip())
    return shown_lines


def _in_turn(sets: Sequence[tuple[Path, Path]], options: argparse.Namespace, progress: Reporting) -> list[Line]:
    """One set after the other, with the progress of each."""
    lines = list[Line]()
    for place, (photos, out) in enumerate(sets, 1):
        if progress.cancelled():
            lines.append(Line(str(photos), str(out), "not begun"))
            continue
        progress.note(f"{place} of {len(sets)}: {shown(photos)}")
        there = _before(photos, out, options)
        lines.append(there or _after(photos, out, run_child(_words(photos, out, options), progress)))
        progress.note(f"{lines[-1].how}: {shown(photos)}")
    return lines


def _side_by_side(
    sets: Sequence[tuple[Path, Path]], workers: Workers, options: argparse.Namespace, progress: Reporting
) -> list[Line]:
    """All sets by workers; how many are done is the progress."""
    lines = [_before(photos, out, options) for photos, out in sets]
    wanted = [place for place, line in enumerate(lines) if line is None]
    options = argparse.Namespace(**{**vars(options), "threads": workers.threads(options.threads)})
    tasks = [Task(str(sets[place][0]), tuple(_words(*sets[place], options))) for place in wanted]
    progress.stage("twins", len(sets))
    progress.advance(done := len(sets) - len(wanted))
    for which, ended in workers.run(tasks, progress):
        photos, out = sets[wanted[which]]
        line = Line(str(photos), str(out), "not begun") if ended is None else _after(photos, out, ended)
        lines[wanted[which]] = line
        progress.note(f"{line.how}: {shown(photos)}")
        progress.advance(done := done + 1)
    return [line or Line(str(sets[at][0]), str(sets[at][1]), "stopped") for at, line in enumerate(lines)]


def _before(photos: Path, out: Path, options: argparse.Namespace) -> Line | None:
    """The line of a set that needs no run; None for the others."""
    there = _finished(out)
    if there is not None and not options.again:
        return _line(photos, out, "done before", there)
    try:
        _check(photos, out)
    except DgsError as error:
        return Line(str(photos), str(out), "failed", " ".join(str(error).split()))
    return None


def _words(photos: Path, out: Path, options: argparse.Namespace) -> list[str]:
    begun = (out / ".run" / ".begun").is_file() or (out / "report.json").is_file()
    return child_arguments(photos, out, options, _finished(out) is None and begun)


def _after(photos: Path, out: Path, ended: Ended) -> Line:
    """The line of a set whose run has ended, however it did."""
    if was_stopped(ended):
        return Line(str(photos), str(out), "stopped")
    if ended.status:
        return Line(str(photos), str(out), "failed", ended.line)
    report = _finished(out)
    return Line(str(photos), str(out), "done") if report is None else _line(photos, out, "done", report)


def _check(photos: Path, out: Path) -> None:
    """What may not be read or written is said before a process is started for it.

    Raises:
        PhotoError: the photos cannot be read. OutputError: nothing can be written.
    """
    try:
        with os.scandir(photos) if photos.is_dir() else photos.open("rb"):
            pass
    except OSError as error:
        raise PhotoError(
            f"'{shown(photos)}' cannot be read ({error.strerror})", "Check the path of the photos"
        ) from error
    check_writable(out)


def child_arguments(photos: Path, out: Path, options: argparse.Namespace, resumed: bool) -> list[str]:
    """The command that makes one twin, with what was given for all."""
    words = ["reconstruct", str(photos.absolute()), "--out", str(out.absolute())]
    for name in _PASSED:
        value, flag = getattr(options, name), f"--{name.replace('_', '-')}"
        if value is True:
            words.append(flag)
        elif value is not None and value is not False:
            words.append(f"{flag}={value.absolute() if isinstance(value, Path) else value}")
    return [*words, "--resume"] if resumed else words


def _finished(out: Path) -> dict[str, Any] | None:
    """The report of a finished twin; None where there is none, or it was stopped before its end."""
    try:
        report: dict[str, Any] = read_json(out / "report.json")
        check_shape(report, _REPORT)
    except (OSError, ValueError):
        return None
    begun_anew = (out / ".run" / ".begun").is_file()
    return report if report["status"] != "cancelled" and not begun_anew and (out / "twin.ply").is_file() else None


def _line(photos: Path, out: Path, how: str, report: dict[str, Any]) -> Line:
    given, seen = report["photos"]["given"], report["photos"]["registered"]
    return Line(
        str(photos),
        str(out),
        how,
        registered=f"{seen} of {given}",
        psnr=report["heldout"]["degraded"].get("psnr"),
        gaussians=report["gaussians"],
        seconds=report["seconds"]["total"],
    )
