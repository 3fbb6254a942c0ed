"""Arguments of the commands that tell and measure what accuracy costs: estimate, tradeoff."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import estimate_command, tradeoff_command

Add = Callable[[argparse.ArgumentParser], None]


def add_effort_commands(commands: Any, add_medium: Add, add_machine: Add, add_progress: Add) -> None:
    """Adds both to the parser's commands."""
    shown = argparse.ArgumentDefaultsHelpFormatter
    estimate = commands.add_parser(
        "estimate",
        help="what a run would take and reach",
        formatter_class=shown,
        description="Tries a few iterations on some of the photos and predicts seconds, memory and accuracy of every "
        "preset; past runs on this machine calibrate it.",
    )
    estimate.add_argument("photos", type=Path, metavar="PHOTOS", help="folder of photos, or a list of them (.txt)")
    add_medium(estimate)
    estimate_command.add_arguments(estimate)
    tradeoff = commands.add_parser(
        "tradeoff",
        help="what each knob costs in time and brings",
        formatter_class=shown,
        description="Trains twins with one knob turned at a time, several seeds each, scores them against the sharp "
        "photos, and draws accuracy over time with the front that nothing beats.",
    )
    tradeoff_command.add_arguments(tradeoff)
    for parser in (estimate, tradeoff):
        add_machine(parser)
        add_progress(parser)
