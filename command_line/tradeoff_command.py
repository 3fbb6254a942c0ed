"""`tradeoff`: what each knob costs in time and brings in accuracy, on a set whose truth is known."""

from __future__ import annotations

import argparse

from ..core.imports import large_imports
from ..studies.tradeoff.settings import TradeoffSettings
from .progress_choice import Reporting
from .study_arguments import StudyWords, add_study, asked_of_study, begin_in, elsewhere

_WORDS = StudyWords(
    results="rows, table, chart and page",
    found="from the photos (their time counts)",
    trained="point",
    part="KNOB",
    parts="preset, iterations, gaussians, resolution, harmonics, blur, 'float width', loss, cameras or effects",
    quick="points",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Trains twins with one knob turned at a time, several seeds each, scores them against the sharp "
        "photos, and draws accuracy over time with the front that nothing beats."
    )
    add_study(parser, _WORDS)
    parser.add_argument(
        "--target", type=float, metavar="DB", help="PSNR whose time is reported; half a dB below the best if not given"
    )


def tradeoff_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Measures, and names the page and the front."""
    with large_imports():
        from ..studies.tradeoff.chart import front_names  # heavy: torch
        from ..studies.tradeoff.runs import measure_tradeoff  # heavy: torch

    settings = TradeoffSettings(**asked_of_study(options), target=options.target)
    begin_in(settings.out, ("tradeoff.json",), options.overwrite)
    content = measure_tradeoff(settings, progress, elsewhere(options, progress))
    out = settings.out
    if settings.rows:
        progress.finished({"rows": ", ".join(settings.rows)})
        return 0
    progress.finished(
        {
            "page": str(out / "tradeoff.html"),
            "table": str(out / "tradeoff.csv"),
            "chart": str(out / "tradeoff.png"),
            "front": ", ".join(front_names(content["points"])),
        }
    )
    return 0
