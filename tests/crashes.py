"""Kills or starves a piece of code at each of its file operations, one after the other.

Python calls an audit hook before every file is opened for writing, renamed, removed or made. A forked child counts
these calls inside one folder; at the chosen one it dies by signal 9, or the operation fails for want of room.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

#: Audit events that change a folder; of 'open' only writing ones.
CHANGES = ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate")
#: What needs room on the disk.
NEEDS_ROOM = ("open", "os.mkdir", "os.link", "os.symlink")
#: Statuses of the child: done, ended with an error that was explained, and a traceback.
DONE, REFUSED, TRACEBACK = 0, 3, 4

Fault = Literal["kill", "full"]


def crashes(work: Callable[[], object], folder: Path, fault: Fault, refusal: type[BaseException]) -> Iterator[int]:
    """Runs `work` in children, each with one fault more, until one has none.

    Args:
        work: changes `folder`; must start no threads before it is called.
        folder: where operations count; to be set up anew by the caller before each step.
        fault: 'kill' dies just before the operation, 'full' lets it and all later ones that need room fail.
        refusal: what may come out of `work` when the disk is full.

    Yields:
        the number of the operation that failed, after the child ended; the caller looks at `folder` then.

    Raises:
        AssertionError: a child ended otherwise than it should.
    """
    at = 1
    while True:
        status = _child(work, folder, fault, refusal, at)
        if status == DONE:
            return
        expected = -signal.SIGKILL if fault == "kill" else REFUSED
        assert status == expected, f"operation {at}, {fault}: the child ended with {status}"
        yield at
        at += 1


def _child(work: Callable[[], object], folder: Path, fault: Fault, refusal: type[BaseException], at: int) -> int:
    process = os.fork()
    if process == 0:
        status = TRACEBACK
        try:
            sys.addaudithook(_Hook(folder, fault, at))
            work()
            status = DONE
        except refusal:
            status = REFUSED
        except BaseException:  # noqa: BLE001  (the child must end here, whatever happened)
            traceback.print_exc()
        finally:
            os._exit(status)
    _, code = os.waitpid(process, 0)
    return os.waitstatus_to_exitcode(code)


class _Hook:
    def __init__(self, folder: Path, fault: Fault, at: int) -> None:
        self.folder, self.fault, self.left = str(folder), fault, at

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event not in CHANGES or not self._counts(event, arguments):
            return
        if self.fault == "full" and event not in NEEDS_ROOM:
            return
        self.left -= 1
        if self.left > 0 or (self.left < 0 and self.fault == "kill"):
            return
        if self.fault == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _counts(self, event: str, arguments: tuple[Any, ...]) -> bool:
        path = arguments[0]
        if isinstance(path, int) or path is None or not os.fsdecode(path).startswith(self.folder):
            return False
        writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT
        return event != "open" or bool(int(arguments[2] or 0) & writes)
