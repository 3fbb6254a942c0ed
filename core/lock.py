"""One process at a time works on a folder."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import FolderInUse, OutputError
from .files import make_folder, output_error, read_json, write_json
from .json_shape import check_shape, count, text
from .names import shown
from .transaction import recover

try:
    from filelock import FileLock, Timeout
except ModuleNotFoundError:  # in a Blender whose Python is used without the installed extension, which brings it
    FileLock = None  # type: ignore[assignment,misc]

#: Held by the operating system for as long as the process lives, so that none is left behind by a kill.
LOCK = ".lock"
#: Who holds it, to be read by others.
OWNER = ".lock-owner.json"
_OWNER = {"process": count, "task": text, "since": text}


@contextmanager
def locked(folder: Path, task: str, wait: float = 0.0) -> Iterator[None]:
    """Nobody else works on `folder` until the block ends; the lock of a process that died is taken over.

    A Blender without the installed extension may have no filelock: what it writes itself, single files in one go, it
    writes without a lock.

    Args:
        folder: made if it is not there.
        task: what this process does with it, for the message that others get.
        wait: seconds for another process to end its work.

    Raises:
        FolderInUse: another process works on it. OutputError: the lock cannot be written.
    """
    make_folder(folder)
    if FileLock is None:
        yield
        return
    lock = FileLock(folder / LOCK, timeout=wait)
    try:
        lock.acquire()
    except Timeout as error:
        raise FolderInUse(
            f"Another process works on '{folder}'{_owner(folder)}", "Wait until it ends, or choose another folder"
        ) from error
    except OSError as error:
        raise output_error(folder / LOCK, error) from error
    try:
        with suppress(OutputError):  # (a full disk must not keep anybody from bringing an earlier state back)
            _sign(folder, task)
        yield
    finally:
        with suppress(OSError):  # nobody reads it once the lock is free
            (folder / OWNER).unlink()
        lock.release()


@contextmanager
def working_on(folder: Path, task: str, note: Callable[[str], None], wait: float = 0.0) -> Iterator[None]:
    """`locked`, after what a process that died left behind was undone or completed; `note` gets what was done."""
    with locked(folder, task, wait):
        if done := recover(folder):
            note(done)
        yield


def _sign(folder: Path, task: str) -> None:
    """Says who works here; raises OutputError."""
    facts = {"process": os.getpid(), "task": task, "since": time.strftime("%Y-%m-%d %H:%M:%S")}
    write_json(folder / OWNER, facts)


def _owner(folder: Path) -> str:
    try:
        facts = read_json(folder / OWNER)
        check_shape(facts, _OWNER)
        return f": process {facts['process']}, {shown(facts['task']):.60}, since {shown(facts['since']):.20}"
    except (OSError, ValueError):  # just begun, or written by something else
        return ""
