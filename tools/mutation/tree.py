"""A copy of the tree that is mutated, and pytest in a forked child of a process that has loaded the libraries."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: A mutant may ask for any amount of memory; the machine is shared (bytes of addresses, most of them libraries').
_MEMORY = 40 << 30


def copied(folder: Path) -> Path:
    """A copy of the tracked and new files of the working tree."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode().split("\0"):
        source = ROOT / name
        if name and source.is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name)
    return folder


@dataclass(frozen=True)
class Ended:
    """A child that ended: pytest's status (negative: a signal; None: it took too long), seconds, and what it wrote."""

    status: int | None
    seconds: float
    output: str


def forked(task: Callable[[], int], tree: Path, log: Path, limit: float, cache: Path) -> Ended:
    """Runs `task` in a child of its own session, in the tree; it and its children are killed after `limit` seconds."""
    began = time.perf_counter()
    child = os.fork()
    if child == 0:
        _child(task, tree, log, cache)
    status: int | None = None
    while time.perf_counter() - began < limit:
        done, raw = os.waitpid(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(raw)
            break
        time.sleep(0.02)
    _kill_session(child, waited=status is not None)
    return Ended(status, time.perf_counter() - began, log.read_text("utf-8", "replace") if log.is_file() else "")


def _kill_session(child: int, waited: bool) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if not waited:
        os.waitpid(child, 0)


def _child(task: Callable[[], int], tree: Path, log: Path, cache: Path) -> None:
    """Never returns."""
    status = 70
    try:
        os.setsid()
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for standard in (1, 2):
            os.dup2(descriptor, standard)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        os.chdir(tree)
        os.environ["NUMBA_CACHE_DIR"] = str(cache)
        sys.path[:] = [str(tree), *(p for p in sys.path if p not in ("", str(ROOT)))]
        for name in [name for name in sys.modules if name.split(".")[0] in ("tools", "run_dgs", "dgs")]:
            del sys.modules[name]
        import numba.core.config

        numba.core.config.reload_config()
        status = int(task())
    except BaseException:  # noqa: BLE001  (the child must end here, whatever happened)
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def preload() -> None:
    """Loads what every test loads, and starts no thread."""
    import hypothesis  # noqa: F401
    import numba  # noqa: F401
    import PIL.Image  # noqa: F401
    import pycolmap  # noqa: F401
    import pytest  # noqa: F401
    import scipy.ndimage
    import scipy.optimize
    import scipy.spatial  # noqa: F401
    import torch  # noqa: F401
