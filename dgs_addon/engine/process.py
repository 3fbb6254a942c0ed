"""How the engine's commands are started beside Blender: the script, its environment, its priority. Knows no Blender.

Jobs lower their priority by themselves (`--control`, see `command_line.control`).
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

#: The command line of the engine, in the clone or in the installed extension.
RUN = Path(__file__).resolve().parents[2] / "run_dgs.py"
#: Blender's own settings for Python would lead the engine's Python to Blender's libraries.
_FOREIGN = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "PYTHONUSERBASE", "LD_PRELOAD", "__PYVENV_LAUNCHER__")
#: Steps of Unix's niceness: where both want a core, Blender gets ten times the command's share of it.
_NICER = 10


def environment() -> dict[str, str]:
    """This process's environment, less what belongs to Blender's Python; it says who asks (see `run_dgs.py`)."""
    kept = {name: value for name, value in os.environ.items() if name not in _FOREIGN}
    kept["DGS_STARTED_BY_BLENDER"] = "1"
    return {**kept, "PYTHONNOUSERSITE": "1", "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8"}


def give_way(pid: int) -> None:
    """Lowers the priority of a process that has just begun, and so of all threads and children to come."""
    if sys.platform == "win32":
        return  # `creation_flags` has done it
    with contextlib.suppress(OSError):  # ended already
        os.setpriority(os.PRIO_PROCESS, pid, min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICER))


@contextlib.contextmanager
def broken_pipes_are_errors() -> Iterator[None]:
    """Who writes in here to a process that has died gets an OSError: some Blenders (4.3) would end instead.

    The signal goes to the thread that writes: it is held back there, and taken if it came.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE not in before:
            if signal.SIGPIPE in signal.sigpending():
                signal.sigwait({signal.SIGPIPE})
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGPIPE})


def creation_flags() -> int:
    """For `subprocess.Popen(creationflags=...)`: on Windows no console window, and Blender's window goes first."""
    if sys.platform != "win32":
        return 0
    return subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS
