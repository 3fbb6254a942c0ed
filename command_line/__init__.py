"""The one place of the command line: `run` takes the arguments and gives the exit status.

Nothing heavy is imported before a command is known, so that `--help` answers at once.
"""

from __future__ import annotations

from .main import run

__all__ = ["run"]
