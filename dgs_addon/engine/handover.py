"""`blender -b -P run_dgs.py -- ...`: Blender's Python passes engine work on to the engine's own."""

from __future__ import annotations

import signal
import subprocess
import sys

from ...core.errors import DgsError
from .interpreter import find_python
from .process import RUN, environment


def hand_over(arguments: list[str]) -> int:
    """Runs the same command in the engine's Python, on the same terminal.

    Args:
        arguments: as typed behind `run_dgs.py`.

    Returns:
        The command's exit status; 2 where there is no engine (one line on stderr says the way out).
    """
    try:
        python = find_python()
    except DgsError as error:
        print(f"{error.what}. {error.way_out}, or name an interpreter in DGS_ENGINE_PYTHON.", file=sys.stderr)
        return 2
    # Ctrl-C reaches both: the engine saves what it has, so this process only waits.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return subprocess.run([str(python), str(RUN), *arguments], env=environment(), check=False).returncode
    finally:
        if before is not None:  # None: the handler was not Python's
            signal.signal(signal.SIGINT, before)
