"""Arguments of the commands that go on from a finished twin."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

Adder = Callable[[argparse.ArgumentParser], None]


def add_twin_commands(commands: argparse._SubParsersAction, machine: Adder, progress: Adder) -> None:
    """Adds `next-view` and `update`.

    Args:
        machine, progress: add the arguments that all commands share.
    """
    from .next_view_command import add_arguments as next_view
    from .update_command import add_arguments as update

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
    parser = commands.add_parser(
        "update",
        help="new photos into a twin",
        description="Registers new photos to a twin, tells changes of the medium from changes of the object, and fits "
        "the twin to them from where it stands; the state before is kept (--rollback).",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    update(parser)
    machine(parser)
    progress(parser)


def add_refinement(group: argparse._ArgumentGroup) -> None:
    """Arguments of `reconstruct` that move cameras."""
    group.add_argument(
        "--refine-cameras",
        action="store_true",
        help="before the training, move cameras and focal length by the loss through the blur; kept "
        "only if held-out photos are explained better (takes about as long as a draft)",
    )
    group.add_argument(
        "--reference-cameras",
        type=Path,
        metavar="MODEL",
        help="true cameras, only to report errors with --refine-cameras",
    )
