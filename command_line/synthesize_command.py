"""`synthesize`: a test set rendered with Blender; the laboratory does the work."""

from __future__ import annotations

import argparse

from ..core.outputs import check_output_folder, claim_output_folder
from .arguments import add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command; the laboratory names its own."""
    from ..dgs_addon.laboratory.command import add_arguments as add_settings  # heavy: numpy

    parser.description = "Renders photos of a known object with Blender, blurred and sharp, with their cameras."
    show_defaults(parser)
    add_settings(parser)
    add_overwrite(parser)
    add_progress(parser)


def synthesize_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the laboratory, which says in one line what to do where there is no Blender."""
    from ..dgs_addon.laboratory.command import run  # heavy: numpy

    check_output_folder(options.out, ("manifest.json", "unfinished.json"), options.overwrite)
    claim_output_folder(options.out)
    return int(run(options, progress) or 0)
