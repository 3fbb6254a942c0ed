"""Commands beside Blender give way to its window. Knows no Blender.

Jobs do so by themselves (`--control`, see `command_line.control`).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

#: Steps of Unix's niceness: where both want a core, Blender gets ten times the command's share of it.
_NICER = 10


def give_way(pid: int) -> None:
    """Lowers the priority of a process that has just begun, and so of all threads and children to come."""
    if sys.platform == "win32":
        return  # `flags` has done it
    with contextlib.suppress(OSError):  # ended already
        os.setpriority(os.PRIO_PROCESS, pid, min(19, os.getpriority(os.PRIO_PROCESS, 0) + _NICER))


def flags() -> int:
    """For `subprocess.Popen(creationflags=...)`: on Windows no console window, and Blender's window goes first."""
    if sys.platform != "win32":
        return 0
    return subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS
