"""`synthesize`: a test set rendered with Blender; the laboratory does the work."""

from __future__ import annotations

import argparse

from ..core.outputs import check_output_folder, claim_output_folder
from .arguments import add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting
from .workers import Task, add_workers, chosen, run_all, words_of

#: Photos of one task: starting Blender takes as long as rendering one.
_TOGETHER = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command; the laboratory names its own."""
    from ..dgs_addon.laboratory.command import add_arguments as add_settings  # heavy: numpy

    parser.description = "Renders photos of a known object with Blender, blurred and sharp, with their cameras."
    show_defaults(parser)
    add_settings(parser)
    add_overwrite(parser)
    add_workers(parser, "photos rendered")
    add_progress(parser)


def synthesize_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the laboratory, which says in one line what to do where there is no Blender."""
    from ..dgs_addon.laboratory.command import run  # heavy: numpy

    check_output_folder(options.out, ("manifest.json", "unfinished.json"), options.overwrite)
    claim_output_folder(options.out)
    workers = chosen(options)
    if workers is not None and options.frames is None:
        run_all(workers, frame_tasks(options), progress, "renders")
    return int(run(options, progress) or 0)


def frame_tasks(options: argparse.Namespace) -> list[Task]:
    """Commands that render all photos, a few each; what is done once for a set is left to the one that gives them."""
    given = {name: value for name, value in vars(options).items() if name not in ("frames", "media", "denoise")}
    given["size"] = "{}x{}".format(*options.size)
    given["object_motion"] = ",".join(f"{one:g}" for one in options.object_motion)
    given |= {"medium": options.media, "no_denoise": not options.denoise}
    words = words_of(argparse.Namespace(**given), ("synthesize",))
    firsts = range(0, options.views, _TOGETHER)
    spans = [f"{first}-{min(first + _TOGETHER, options.views) - 1}" for first in firsts]
    return [Task(f"photos {span}", (*words, "--frames", span)) for span in spans]
