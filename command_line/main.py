"""Parses the arguments, runs the command, and turns every failure into one line and a status."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Callable

from ..core.errors import Cancelled, DgsError
from .interruption import Interruption
from .parser import build_parser
from .progress_choice import Reporting, choose_progress

#: Exit status of a fault of ours, not the user's.
BUG = 1


def run(arguments: list[str]) -> int:
    """Runs one command.

    Args:
        arguments: as typed behind `run_dgs.py`.

    Returns:
        0 if all went well; 2 for bad input (one line on stderr says what and the way out); 130 if
        the user stopped it (what was finished is saved); 1 for a bug (with its traceback).
    """
    parser = build_parser(arguments)
    try:
        options = parser.parse_args(arguments)
    except SystemExit as stop:  # argparse has said why
        return int(stop.code or 0)
    if options.command is None:
        parser.print_help()
        return 2
    interruption = Interruption()
    progress = choose_progress(getattr(options, "progress", "none"), interruption)
    if getattr(options, "control", False):
        from .control import obey

        obey(interruption)
    with interruption, progress:
        return _guarded(_command(options.command), options, progress)


def _command(name: str) -> Callable[[argparse.Namespace, Reporting], int]:
    if name == "reconstruct":
        from .reconstruct_command import reconstruct_command

        return reconstruct_command
    if name == "cameras":
        from .cameras_command import cameras_command

        return cameras_command
    if name == "render":
        from .render_command import render_command

        return render_command
    if name == "blend":
        from .blend_command import blend_command

        return blend_command
    if name == "synthesize":
        from .synthesize_command import synthesize_command

        return synthesize_command
    if name == "compare":
        from .compare_command import compare_command

        return compare_command
    if name == "inspect":
        from .inspect_command import inspect_command

        return inspect_command
    if name == "estimate":
        from .estimate_command import estimate_command

        return estimate_command
    if name == "tradeoff":
        from .tradeoff_command import tradeoff_command

        return tradeoff_command
    if name == "measure-psf":
        from .measure_psf_command import measure_psf_command

        return measure_psf_command
    if name == "stress":
        from .stress_command import stress_command

        return stress_command
    if name == "next-view":
        from .next_view_command import next_view_command

        return next_view_command
    if name == "update":
        from .update_command import update_command

        return update_command
    from .doctor import doctor_command

    return doctor_command


def _guarded(
    command: Callable[[argparse.Namespace, Reporting], int], options: argparse.Namespace, progress: Reporting
) -> int:
    try:
        return command(options, progress)
    except DgsError as error:
        return _failed(progress, " ".join(str(error).split()), error.exit_code)
    except KeyboardInterrupt:
        return _failed(progress, "Stopped at once; checkpoints and files written before are kept.", Cancelled.exit_code)
    except MemoryError:
        return _failed(progress, "Out of memory. Use --max-size or --max-gaussians to make the work smaller.", 2)
    except BrokenPipeError:
        # Whoever read our output has gone; the interpreter must not try to flush it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except Exception as error:  # noqa: BLE001 (the last door: anything that comes here is our fault)
        traceback.print_exc(file=sys.stderr)
        return _failed(progress, f"A bug, please report it: {type(error).__name__}: {error}", BUG)


def _failed(progress: Reporting, line: str, status: int) -> int:
    progress.failed(line, status)
    print(line, file=sys.stderr, flush=True)
    return status
