"""`next-view`: which photo to take next."""

from __future__ import annotations

import argparse
import json
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import FormatError
from ..core.imports import large_imports
from .arguments import add_machine, add_progress, show_defaults, whole
from .progress_choice import Reporting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..core.uncertainty.next_view import Suggestion

#: Lines of the table below the chosen views.
OTHERS_SHOWN = 7
#: Views, and samples of each, that are looked at at most: ten thousand take hours already.
MOST_VIEWS = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Ranks cameras by what a photo from there is expected to add to a twin, through its blur; "
        "writes TWIN/next_views.json."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help="folder that 'reconstruct --out' wrote")
    add(
        "--candidates",
        default="orbit",
        metavar="PATH",
        help="where the camera can go: rail | orbit | dome (around what the photos look at), or a file of cameras "
        "such as a transforms.json or a COLMAP folder",
    )
    add("--number", type=whole(1, MOST_VIEWS), default=24, metavar="N", help="candidates on a rail, orbit or dome")
    add("--count", type=whole(1, MOST_VIEWS), default=3, metavar="N", help="views to choose one after the other")
    samples = "samples of what is left open; more are steadier"
    add("--samples", type=whole(1, MOST_VIEWS), default=6, metavar="N", help=samples)
    add("--photos", type=Path, metavar="DIR", help="where the twin's photos lie now, if they were moved")
    add("--without-blur", action="store_true", help="rank as if the medium were clear, for comparison")
    add("--json", action="store_true", help="print JSON instead of the table")
    add_machine(parser)
    add_progress(parser)


def next_view_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints the ranking; writes TWIN/next_views.json, and TWIN/known.npy: how far photos fix each splat's colour."""
    from ..core.lock import working_on  # late: slows --help

    if not options.twin.is_dir():
        raise FormatError(f"There is no folder '{options.twin}'", "Give the --out folder of 'reconstruct'")
    with working_on(options.twin, "next-view", progress.note):
        return _rank_and_write(options, progress)


def _rank_and_write(options: argparse.Namespace, progress: Reporting) -> int:
    with large_imports():
        from ..core.machine import use_machine  # late: slows --help
        from ..core.report.known import add_chapter  # heavy: torch
        from ..core.twin.folder import TwinFolder  # late: slows --help
        from ..core.twin.opened import open_twin  # heavy: torch
        from ..core.uncertainty.candidates import CAMERA_PATHS, candidates, candidates_from  # heavy: torch
        from ..core.uncertainty.next_view import NextViewSettings, rank  # heavy: torch
        from ..core.uncertainty.pictures import draw_expected  # heavy: torch

    began = time.perf_counter()
    use_machine(options.threads)
    twin = open_twin(options.twin, progress, options.photos)
    cameras = [view.camera for view in twin.views]
    if options.candidates in CAMERA_PATHS:
        offered = candidates(options.candidates, cameras, options.number)
    else:
        offered = candidates_from(Path(options.candidates))
    settings = NextViewSettings(options.count, options.samples, through_blur=not options.without_blur)
    ranking = rank(twin, offered, settings, progress)
    ranked = ranking.suggestions
    held = ranking.error["held_photos"]
    content = {
        "twin": str(options.twin),
        "candidates": options.candidates,
        "through_blur": settings.through_blur,
        "expected_error": ranking.error,
        "views": [suggestion.plain() for suggestion in ranked],
        "seconds": round(time.perf_counter() - began, 3),
    }
    folder = TwinFolder(options.twin)
    with folder.changing() as change:
        drawn = draw_expected(change.new.next_view_folder, ranking.views, ranking.error["contrast"])
        change.new.save_next_views(content, ranking.determined.numpy().astype("float32"))
        if folder.report_page.is_file():
            shutil.copyfile(folder.report_page, change.new.report_page)
            measured = f"How wrong the twin is was measured on {held} photos that it was not trained on."
            usual = "No photo was held out to measure how wrong the twin is: usual values stand in."
            add_chapter(change.new.report_page, drawn, measured if held else usual)
    path = folder.next_view_list
    if options.json:
        print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False), flush=True)
        return 0
    if options.progress != "json":
        print("\n".join(table(ranked)), flush=True)
    progress.finished(
        {"next": ", ".join(s.camera.name for s in ranked if s.order), "views": str(path), "seconds": content["seconds"]}
    )
    return 0


def table(ranked: Sequence[Suggestion]) -> list[str]:
    """Lines for a terminal: the chosen views in their order, then the best of the others.

    'wrong by': expected rms error of the sharp view, in 8-bit steps.
    """
    head = f"{'take':<5} {'view':<20} {'new':>6} {'gain':>12} {'guessed':>8} {'wrong by':>9} {'shows twin':>11}"
    lines = [f"{head}   centre (world units)"]
    chosen = [s for s in ranked if s.order]
    for s in [*chosen, *[s for s in ranked if not s.order][:OTHERS_SHOWN]]:
        centre = ", ".join(f"{value:.4g}" for value in s.camera.centre)
        order = f"{s.order}." if s.order else "-"
        lines.append(
            f"{order:<5} {s.camera.name:<20} {100 * s.covers:>4.1f} % {s.gain.bits:>7.0f} bits "
            f"{100 * s.gain.guessed:>6.0f} % {255 * s.error:>9.1f} {100 * s.gain.covered:>9.0f} %   ({centre})"
        )
    return lines
