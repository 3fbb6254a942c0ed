"""Kills or starves a piece of code at each of its file operations, one after the other.

Python calls an audit hook before every file is opened for writing, renamed, removed or made. A forked child counts
these calls inside one folder; at the chosen one it dies by signal 9, or the operation fails for want of room. Where
tools/file_faults.c was loaded before the C library (tools/crash_test.py does that), it counts instead: every write and
fsync, too, and what native code does.

What a kill cannot show is what a power cut would lose; `unsynced` finds renames of files that were not on the disk yet.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from dgs.core.transaction import COMMIT, OUTGOING

#: Audit events that change a folder; of 'open' only writing ones.
CHANGES = ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate")
#: What needs room on the disk.
NEEDS_ROOM = ("open", "os.mkdir", "os.link", "os.symlink")
#: No command makes so many changes.
NEVER = 1 << 30
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
        status = status_of(lambda: (arm(folder, fault, at), work()), refusal)  # noqa: B023  (it is over by then)
        if status == DONE:
            return
        expected = -signal.SIGKILL if fault == "kill" else REFUSED
        assert status == expected, f"operation {at}, {fault}: the child ended with {status}"
        yield at
        at += 1


#: Modes of tools/file_faults.c.
_HOW: dict[Fault, int] = {"kill": 2, "full": 3}
#: Whether tools/file_faults.c stands before the C library in this process.
NATIVE = hasattr(ctypes.CDLL(None), "faults_arm")


def arm(folder: Path, fault: Fault, at: int) -> None:
    """From now on this process fails at the `at`-th change of `folder`; there is no way back."""
    if NATIVE:
        ctypes.CDLL(None).faults_arm(os.fsencode(folder), _HOW[fault], ctypes.c_long(at))
    else:
        sys.addaudithook(_Hook(folder, fault, at))


def arm_children(folder: Path, fault: Fault, at: int) -> None:
    """Processes that this one starts from now on fail at their `at`-th change of `folder`; needs `NATIVE`."""
    os.environ |= {"FAULTS_FOLDER": str(folder), "FAULTS_HOW": str(_HOW[fault]), "FAULTS_AT": str(at)}


def child_of(process: int, word: str, seconds: float = 120.0) -> int | None:
    """Waits for a process that another one started, whose command line holds a word; None if that one ends before."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if not is_alive(process):
            return None
        for found in (int(name.name) for name in Path("/proc").iterdir() if name.name.isdigit()):
            with suppress(OSError):
                parent = Path(f"/proc/{found}/stat").read_text().rpartition(")")[2].split()[1]
                if int(parent) == process and word in Path(f"/proc/{found}/cmdline").read_text():
                    return found
        time.sleep(0.005)
    return None


def is_alive(process: int) -> bool:
    """Whether a process runs: one that has ended and is not waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def counted(work: Callable[[], object], folder: Path) -> int:
    """How many changes of `folder` `work` makes, in a forked child in which none fails."""
    reads, writes = os.pipe()

    def count() -> None:
        hook = _Hook(folder, "kill", NEVER)
        if NATIVE:
            arm(folder, "kill", NEVER)
        else:
            sys.addaudithook(hook)
        work()
        done = ctypes.CDLL(None).faults_count(0) if NATIVE else NEVER - hook.left
        os.write(writes, str(done).encode())

    assert status_of(count) == DONE
    os.close(writes)
    with os.fdopen(reads) as pipe:
        return int(pipe.read())


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
        if not any(_within(path, self.folder) for path in arguments[: 2 if event in ("os.rename", "os.link") else 1]):
            return False
        writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT
        return event != "open" or bool(int(arguments[2] or 0) & writes)


def _within(path: object, folder: str) -> bool:
    """Whether a call's path lies in the folder; names beside an open folder (`dir_fd`) are those of shutil.rmtree."""
    if not isinstance(path, (str, bytes, os.PathLike)):
        return False
    return os.path.abspath(os.fsdecode(path)).startswith(folder)


class SmallDisk:
    """A real disk, in memory, over a folder that is there and empty; seen and kept by this process and its children.

    Args:
        folder: where it stands (run this in a child: it stays until the process ends).

    Raises:
        OSError: this user may not mount one.
    """

    #: Flags of mount(2) and unshare(2).
    _NEW_MOUNTS, _NEW_USERS, _PRIVATE, _REMOUNT = 0x20000, 0x10000000, (1 << 18) + (1 << 14), 32
    _AMPLE = 1 << 26

    def __init__(self, folder: Path) -> None:
        self._folder, self._libc = folder, ctypes.CDLL(None, use_errno=True)
        if self._libc.unshare(self._NEW_MOUNTS) and self._libc.unshare(self._NEW_USERS | self._NEW_MOUNTS):
            raise OSError(ctypes.get_errno(), "unshare")
        self._libc.mount(b"none", b"/", None, self._PRIVATE, None)
        self._mount(0, self._AMPLE)

    def leave_room(self, size: int) -> None:
        """So many bytes more than what lies on it."""
        disk = os.statvfs(self._folder)
        self._mount(self._REMOUNT, max((disk.f_blocks - disk.f_bfree) * disk.f_bsize + size, 1))  # (0: no limit)

    def enlarge(self) -> None:
        """There is room for everything."""
        self._mount(self._REMOUNT, self._AMPLE)

    def _mount(self, flags: int, size: int) -> None:
        if self._libc.mount(b"tmpfs", os.fsencode(self._folder), b"tmpfs", flags, f"size={size}".encode()):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(self._folder))


def status_of(work: Callable[[], object], refusal: type[BaseException] = OSError) -> int:
    """Status of a forked child that runs `work`: DONE, REFUSED, TRACEBACK, or the negative signal that ended it."""
    process = os.fork()
    if process == 0:
        status = TRACEBACK
        try:
            work()
            status = DONE
        except refusal:
            status = REFUSED
        except BaseException:  # noqa: BLE001  (the child must end here, whatever happened)
            traceback.print_exc()
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def can_mount() -> bool:
    """Whether this user may mount a small disk."""
    with tempfile.TemporaryDirectory() as folder:
        return status_of(lambda: SmallDisk(Path(folder))) == DONE


def unsynced(work: Callable[[], object], folder: Path) -> list[str]:
    """What a power cut could lose though `work` relies on it, in this process (run it in a child: hooks stay).

    Before a file or folder gets another name, its whole content must have been synced since it was last written; when
    `work` has ended, so must every folder in which names changed. What is on its way out does not count.

    Returns:
        a sentence for each fault.
    """
    watch = _Durability(str(folder))
    usual = os.fsync
    os.fsync = watch.synced_by(usual)  # (the real call is made)
    try:
        sys.addaudithook(watch)
        work()
    finally:
        os.fsync, watch.folder = usual, "\0"
    left = sorted(name for name in watch.changed if os.path.isdir(name))
    return watch.faults + [f"'{name}' changed its names and was not synced" for name in left]


class _Durability:
    def __init__(self, folder: str) -> None:
        self.folder, self.faults = folder, list[str]()
        self.changed: set[str] = set()
        self._synced: dict[str, tuple[int, int]] = {}
        found = (os.path.join(at, name) for at, _, names in os.walk(folder) for name in names)
        self._from_before = {_version(path) for path in found}  # (links to these need no sync)

    def synced_by(self, usual: Callable[[int], None]) -> Callable[[int], None]:
        def fsync(handle: int) -> None:
            usual(handle)
            path = os.readlink(f"/proc/self/fd/{handle}")
            self._synced[path] = _version(path)
            self.changed.discard(path)

        return fsync

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "os.rename" or not _within(arguments[1], self.folder):
            return
        old, new = (os.path.abspath(os.fsdecode(path)) for path in arguments[:2])
        if f"/{COMMIT}/{OUTGOING}/" in new:
            return  # (it goes)
        for path in (old, *(os.path.join(at, name) for at, _, files in os.walk(old) for name in files)):
            known = self._synced.get(path)
            version = _version(path)
            if not os.path.isdir(path) and version not in (known, *self._from_before):
                self.faults.append(f"'{path}' becomes '{new}' before its content is on the disk")
            self._synced[new + path[len(old) :]] = version
        self.changed |= {os.path.dirname(new)}


def _version(path: str) -> tuple[int, int]:
    status = os.stat(path)
    return status.st_ino, status.st_mtime_ns
