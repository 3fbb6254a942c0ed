"""`serve`: draws twins for a program that asks for picture after picture."""

from __future__ import annotations

import argparse
import os
import sys

from ..core.imports import large_imports
from .arguments import add_machine, show_defaults
from .control import follow_master
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Draws twins for a program, such as Blender: it writes JSON lines to the standard input, shares memory, and "
        "reads a line for each. Ends when the standard input is closed. See core/serving/messages.py."
    )
    show_defaults(parser)
    add_machine(parser)


def serve_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Answers until its master has gone."""
    follow_master()
    # What libraries print must not come between our lines.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)

    with large_imports():
        from ..core.serving.server import serve  # heavy: torch, numba

    def write(line: str) -> None:
        answers.write(f"{line}\n")
        answers.flush()

    serve(sys.stdin, write, options.device, options.threads)
    return 0
