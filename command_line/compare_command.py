"""`compare`: several ways to a twin from the same blurred photos, scored against the sharp ones."""

from __future__ import annotations

import argparse

from ..core.imports import large_imports
from ..studies.comparison.settings import CompareSettings
from .arguments import whole
from .progress_choice import Reporting
from .study_arguments import StudyWords, add_study, asked_of_study, begin_in, elsewhere

_WORDS = StudyWords(
    results="rows, table and pictures",
    found="from the blurred photos",
    trained="method",
    part="METHOD",
    parts="plain, paper, dgs, oracle, 'wiener N vW' or 'rl N vW'",
    quick="methods",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Trains twins from the same blurred photos in several ways (plain, Wiener or Richardson-Lucy "
        "first, the paper's loss, DGS, and from the sharp photos) and scores them against the sharp photos."
    )
    add_study(parser, _WORDS)
    add = parser.add_argument
    add("--steps", type=whole(1), metavar="N", help="of each training; the product's own if not given")
    add("--max-gaussians", type=whole(1), metavar="N", help="of each twin; the product's own if not given")
    add("--mismatch", action="store_true", help="instead: what happens when the medium is not the one that was given")


def compare_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the comparison, or the mismatch study, and names the table."""
    settings = CompareSettings(
        **asked_of_study(options), steps=options.steps, max_gaussians=options.max_gaussians, mismatch=options.mismatch
    )
    begin_in(settings.out, ("compare.json", "mismatch.json"), options.overwrite)
    if settings.mismatch:
        with large_imports():
            from ..studies.comparison.mismatch import study  # heavy: torch

        study(settings, progress)
        progress.finished({"table": str(settings.out / "mismatch.md")})
        return 0
    with large_imports():
        from ..studies.comparison.runs import compare  # heavy: torch

    content = compare(settings, progress, elsewhere(options, progress))
    if settings.rows:
        progress.finished({"rows": ", ".join(settings.rows)})
        return 0
    middle = {method: entry["median"]["psnr"] for method, entry in content["methods"]["each"].items()}
    progress.finished({"table": str(settings.out / "compare.md"), **{f"{m} PSNR": middle[m] for m in middle}})
    return 0
