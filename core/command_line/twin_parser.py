"""Arguments of the commands that go on from a finished twin."""

from __future__ import annotations

import argparse
from collections.abc import Callable

Adder = Callable[[argparse.ArgumentParser], None]


def add_twin_commands(commands: argparse._SubParsersAction, machine: Adder, progress: Adder) -> None:
    """Adds `next-view`.

    Args:
        machine, progress: add the arguments that all commands share.
    """
    from .next_view_command import add_arguments as next_view

    parser = commands.add_parser(
        "next-view",
        help="which photo to take next",
        description="Ranks cameras by what a photo from there is expected to tell about a twin, through its blur; "
        "writes TWIN/next_views.json.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    next_view(parser)
    machine(parser)
    progress(parser)
