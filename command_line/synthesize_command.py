"""`synthesize`: a test set rendered with Blender; the laboratory does the work."""

from __future__ import annotations

import argparse

from .progress_choice import Reporting


def synthesize_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the laboratory, which says in one line what to do where there is no Blender."""
    from ..dgs_addon.laboratory.command import run

    return int(run(options, progress) or 0)
