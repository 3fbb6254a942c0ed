"""`change`: what has changed between two twins of one object."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.imports import large_imports
from .arguments import add_overwrite, add_progress, show_defaults, whole
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Compares two twins of one object at two times: what moved, grew, vanished or appeared, by how much, with its "
        "95 % interval. Light, medium and the worlds of the cameras are separated first. docs/measure.md shows more."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("before", type=Path, metavar="BEFORE", help="folder that 'reconstruct --out' wrote")
    add("later", type=Path, metavar="AFTER", help="another one, of the same object later")
    files = "folder for change.json, change.csv, change.png and change.glb"
    add("--out", type=Path, required=True, metavar="DIR", help=files)
    known = parser.add_mutually_exclusive_group()
    measures = "JSON of places on %s and measures of them, as 'measure' takes it; one is the known length"
    known.add_argument("--measures", type=Path, metavar="FILE", help=measures % "BEFORE")
    known.add_argument("--measures-after", type=Path, metavar="FILE", help=measures % "AFTER")
    length = "a measure of that file whose length is known, such as edge=120mm or edge=120+-0.5mm, for changes in mm"
    add("--scale", metavar="NAME=LENGTH", help=f"{length}; else the file's own, or px-equivalents")
    add("--photos-before", type=Path, metavar="DIR", help="where the photos of BEFORE lie now, if they were moved")
    add("--photos-after", type=Path, metavar="DIR", help="where the photos of AFTER lie now, if they were moved")
    add("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")
    add_overwrite(parser)
    add_progress(parser)


def change_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT and prints what has changed."""
    with large_imports():
        from ..core.change import written  # heavy: torch

    job = written.ChangeJob(
        options.before,
        options.later,
        options.out,
        options.overwrite,
        options.photos_before,
        options.photos_after,
        options.threads,
        options.measures or options.measures_after,
        options.measures_after is not None,
        options.scale,
    )
    found = written.find_changes(job, progress)
    if options.progress != "json":
        print("\n".join(written.lines(found)), flush=True)
    share = f"{100 * found.changed:.2f} %"
    progress.finished({"regions": len(found.regions), "changed": share, "change": str(options.out)})
    return 0
