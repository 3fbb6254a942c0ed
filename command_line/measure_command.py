"""`measure`: lengths, widths, angles and areas on a twin, with their intervals."""

from __future__ import annotations

import argparse
from pathlib import Path

from .arguments import add_overwrite, add_progress, show_defaults, whole
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
    add("points", type=Path, metavar="FILE", help="JSON of places and measures: docs/measure.md")
    known = "a measure whose length is known, such as edge=120mm or edge=120+-0.5mm; px-equivalents if none is"
    add("--scale", metavar="NAME=LENGTH", help=known)
    add("--out", type=Path, metavar="FILE", help="write them, too: ends with .json or .csv")
    add("--photos", type=Path, metavar="DIR", help="where the twin's photos lie now, if they were moved")
    add("--json", action="store_true", help="print JSON instead of the table")
    add("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")
    add_overwrite(parser)
    add_progress(parser)


def measure_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints what was measured; writes OUT if it is named."""
    from ..core.measure.written import MeasureJob, as_text, lines, measure_twin  # heavy: torch

    asked = (options.twin, options.points, options.scale, options.photos, options.out)
    findings = measure_twin(MeasureJob(*asked, options.overwrite, options.threads), progress)
    if options.json:
        print(as_text(findings, ".json"), end="", flush=True)
        return 0
    if options.progress != "json":
        print("\n".join(lines(findings)), flush=True)
    done = sum(one.value is not None for one in findings.measures)
    progress.finished({"measured": f"{done} of {len(findings.measures)}"})
    return 0
