"""The one place of the command line: `run` takes the arguments and gives the exit status.

Nothing heavy is imported before a command is known, so that `--help` answers at once.
"""

from __future__ import annotations

__all__ = ["run"]


def run(arguments: list[str]) -> int:
    """Runs one command; see `main.run`."""
    from .main import run as run_command  # late: the package is read before it is mounted, too

    return run_command(arguments)
