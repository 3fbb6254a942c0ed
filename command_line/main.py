"""Parses the arguments, runs the command, and turns every failure into one line and a status."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from pathlib import Path
from typing import NoReturn

from ..core.errors import Cancelled, DgsError
from ..core.names import check_given, fault_of, shown
from ..core.version import VERSION
from .interruption import Interruption
from .library_output import library_output_aside
from .progress_choice import Reporting, choose_progress
from .refusals import denial, refusal
from .table import COMMANDS, Command, command_of

#: Exit status of a fault of ours, not the user's.
BUG = 1


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line instead of printing the usage first."""

    def error(self, message: str) -> NoReturn:
        """Ends with one line, exit code 2."""
        self.exit(2, f"{message}. See '{self.prog} --help'.\n")


def build_parser(arguments: list[str]) -> argparse.ArgumentParser:
    """The parser of all commands; `command` is None if none was given.

    Args:
        arguments: what will be parsed. Only the command that they name is asked for its own arguments, so that
            nothing is read that this run does not need.
    """
    parser = OneLineParser(
        prog="dgs" if Path(sys.argv[0]).stem == "dgs" else "run_dgs.py",  # as the installed command, or in a clone
        description="Descattering Gaussian splatting: a sharp 3D twin from photos through something that blurs.",
    )
    parser.add_argument("--version", action="version", version=f"dgs {VERSION}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=OneLineParser)
    asked = command_of(arguments)
    for command in COMMANDS:
        own = commands.add_parser(command.name, help=command.help)
        if command is asked:
            command.add_arguments(own)
    return parser


def run(arguments: list[str]) -> int:
    """Runs one command.

    Args:
        arguments: as typed behind `run_dgs.py`.

    Returns:
        0 if all went well; 2 for bad input (one line on stderr says what and the way out); 130 if
        the user stopped it (what was finished is saved); 1 for a bug (with its traceback).
    """
    wrong = next((argument for argument in arguments if fault_of(argument)), None)
    if wrong is not None:
        fault = fault_of(wrong)
        print(f"'{shown(wrong)}' {fault}. Rename the file or folder.", file=sys.stderr, flush=True)
        return DgsError.exit_code
    parser = build_parser(arguments)
    try:
        options = parser.parse_args(arguments)
    except SystemExit as stop:  # argparse has said why
        return int(stop.code or 0)
    command = command_of(arguments)
    if command is None:
        parser.print_help()
        return 2
    if command.needs_engine:
        return _reported(command, options)
    with library_output_aside(command.name) as log:
        status = _reported(command, options)
        if status in (0, Cancelled.exit_code) or not log.stat().st_size:
            log.unlink()
        else:
            print(f"What Blender's libraries said meanwhile is in '{log}'.", file=sys.stderr, flush=True)
    return status


def _reported(command: Command, options: argparse.Namespace) -> int:
    """Runs a command with its progress shown, and stops it where the user or another program asks for it."""
    interruption = Interruption(command.saves)
    progress = choose_progress(getattr(options, "progress", "none"), interruption)
    if getattr(options, "control", False):
        from .control import obey  # late: only where a program steers the command

        obey(interruption)
    with interruption, progress:
        status = _guarded(command, options, progress)
        interruption.said()
        return status


def _guarded(command: Command, options: argparse.Namespace, progress: Reporting) -> int:
    given = [value for value in vars(options).values() if isinstance(value, Path)]
    try:
        for path in given:
            check_given(path)
        return command.handler()(options, progress)
    except DgsError as error:
        return _failed(progress, denial(error) or " ".join(str(error).split()), error.exit_code)
    except KeyboardInterrupt:
        kept = "Stopped at once; checkpoints and files written before are kept." if command.saves else "Stopped."
        return _failed(progress, kept, Cancelled.exit_code)
    except MemoryError:
        return _failed(progress, "Out of memory. Use --max-size or --max-gaussians to make the work smaller.", 2)
    except BrokenPipeError:
        # Whoever read our output has gone; the interpreter must not try to flush it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except OSError as error:
        line = refusal(error, given)
        return _failed(progress, line, DgsError.exit_code) if line else _bug(progress, error)
    except Exception as error:  # noqa: BLE001 (the last door: anything that comes here is our fault)
        return _bug(progress, error)


def _bug(progress: Reporting, error: Exception) -> int:
    traceback.print_exception(error, file=sys.stderr)
    return _failed(progress, f"A bug, please report it: {type(error).__name__}: {error}", BUG)


def _failed(progress: Reporting, line: str, status: int) -> int:
    progress.failed(line, status)
    print(line, file=sys.stderr, flush=True)
    return status
