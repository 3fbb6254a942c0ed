"""`measure`: lengths, widths, angles and areas on a twin, with their intervals."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

from ..core.imports import large_imports
from .arguments import add_overwrite, add_progress, show_defaults, whole
from .control import follow_master
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Measures lengths, polylines, angles, areas and widths of lines between places set on photos of a twin; "
        "each with its standard deviation and the interval that holds the truth in 95 of 100 cases."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help="folder that 'reconstruct --out' wrote")
    asked = (
        "JSON of places and measures: docs/measure.md; '-': lines of it from the standard input, each answered by one"
    )
    add("points", type=Path, metavar="FILE", help=asked)
    known = "a measure whose length is known, such as edge=120mm or edge=120+-0.5mm; px-equivalents if none is"
    add("--scale", metavar="NAME=LENGTH", help=known)
    printed = "printed markers that give the scale, such as aruco:4x4_50,40mm or charuco:7x5,30mm,22mm ('board' prints)"
    add("--board", metavar="BOARD", help=printed)
    add("--out", type=Path, metavar="FILE", help="write them, too: ends with .json or .csv")
    add("--photos", type=Path, metavar="DIR", help="where the twin's photos lie now, if they were moved")
    add("--json", action="store_true", help="print JSON instead of the table")
    add("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")
    add_overwrite(parser)
    add_progress(parser)


def measure_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints what was measured; writes OUT if it is named."""
    with large_imports():
        from ..core.measure import listening, written  # heavy: torch

    if str(options.points) == "-":
        return _listening(options, progress, listening.listen)
    asked = (options.twin, options.points, options.scale, options.photos, options.out)
    findings = written.measure_twin(
        written.MeasureJob(*asked, options.overwrite, options.threads, options.board), progress
    )
    if options.json:
        print(written.as_text(findings, ".json"), end="", flush=True)
        return 0
    if options.progress != "json":
        print("\n".join(written.lines(findings)), flush=True)
    done = sum(one.value is not None for one in findings.measures)
    progress.finished({"measured": f"{done} of {len(findings.measures)}"})
    return 0


def _listening(options: argparse.Namespace, progress: Reporting, listen: Callable[..., None]) -> int:
    """Answers until its master has gone."""
    follow_master()
    # What libraries print must not come between our lines.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)

    def write(line: str) -> None:
        answers.write(f"{line}\n")
        answers.flush()

    listen(options.twin, options.photos, options.threads, sys.stdin, write, progress)
    return 0
