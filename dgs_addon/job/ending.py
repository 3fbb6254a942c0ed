"""What the end of the engine's process means, in a sentence with the way out. Knows no Blender."""

from __future__ import annotations

import signal

from .state import Phase

#: Windows' name for ended by the system or crashed, as an unsigned status.
_WINDOWS = {0xC0000005: "memory access violation", 0xC00000FD: "stack overflow", 0xC000013A: "Ctrl-C"}
_CAUSES = {
    "SIGKILL": "the system ran out of memory, or someone ended it",
    "SIGSEGV": "a crash in native code",
    "SIGABRT": "native code gave up",
    "SIGILL": "this processor lacks an instruction that the libraries need",
    "SIGBUS": "a disk that is full or gone, or a damaged file",
    "SIGTERM": "someone ended it",
}
_KEPT = "What was saved up to 30 s before is kept: press Resume to go on from there."
_CANCELLED = 130


def outcome(status: int, said: str, cancelled: bool) -> tuple[Phase, str]:
    """How a job ended.

    Args:
        status: exit status; negative is the signal that ended the process.
        said: the engine's own error, or ''.
        cancelled: whether the user had asked to stop.

    Returns:
        The phase, and what went wrong ('' if nothing did).
    """
    if status == 0:
        return "done", ""
    if status == _CANCELLED or (cancelled and status < 0):
        return "cancelled", ""
    if said:
        return "failed", said
    return "failed", _unsaid(status)


def _unsaid(status: int) -> str:
    if status < 0:
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = f"signal {-status}"
        return f"The engine was ended by {name} ({_CAUSES.get(name, 'outside our control')}). {_KEPT}"
    crash = _WINDOWS.get(status & 0xFFFFFFFF)
    if crash is not None:
        return f"The engine crashed ({crash}). {_KEPT}"
    return f"The engine ended with status {status} and said nothing; press Show Log to see its last words."
