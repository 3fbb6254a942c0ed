"""Lets another program steer a command: it writes lines to our standard input.

`cancel` stops at the next safe point, `pause` and `continue` do what they say. When the other end is
closed, or its process dies in any way, this process ends at once: nobody is left to want its work.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading

from .interruption import Interruption

#: Exit status of a command whose master has gone.
ORPHANED = 3
_PR_SET_PDEATHSIG = 1
#: How far our share of the processor steps back.
_NICE = 10


def follow_master() -> None:
    """Has the system end this process with the thread that started it, where it can."""
    if sys.platform == "linux":  # comes even while native code holds the interpreter
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def obey(interruption: Interruption) -> None:
    """Starts listening to standard input, in a thread that does not keep the process alive."""
    follow_master()
    if hasattr(os, "nice"):  # the master's window goes first; Windows has other means, and the master uses them
        os.nice(_NICE)
    threading.Thread(target=_listen, args=(interruption,), name="control", daemon=True).start()


def _listen(interruption: Interruption) -> None:
    commands = {"cancel": interruption.ask, "pause": interruption.pause, "continue": interruption.go_on}
    rest = b""
    while data := os.read(0, 4096):
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            command = commands.get(line.strip().decode("ascii", "replace"))
            if command is not None:
                command()
    os._exit(ORPHANED)
