"""Starts the child process in which pycolmap runs. Light: a child can start before the rest is imported."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WORKER = Path(__file__).with_name("worker.py")
#: What the folder of a child that was started early is called, inside the twin's.
SCRATCH = ".place-"
#: A child that was started early begins when this file is in its folder.
GO = "go"
#: Seconds between two checks whether a file is there.
CHECK_EVERY = 0.01
#: Seconds that a child waits for its job, then it gives up.
PATIENCE = 600.0


def begin(folder: Path, threads: int, *words: str, worker: Path = WORKER) -> subprocess.Popen[bytes]:
    """The child on a job folder; it ends when its stdin does."""
    environment = dict(os.environ)
    # The child must find the packages that this process found, also inside Blender.
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    environment["OMP_WAIT_POLICY"] = "passive"
    environment["OMP_NUM_THREADS"] = str(threads)
    # Small matrices only: scipy's threaded BLAS spins while it waits, and starves everything else.
    environment["OPENBLAS_NUM_THREADS"] = "1"
    environment["GLOG_minloglevel"] = "3"
    with (folder / "native.log").open("wb") as log:
        return subprocess.Popen(
            [sys.executable, str(worker), str(folder), *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            env=environment,
        )


def wait_for(path: Path) -> None:
    """Until a file is there.

    Raises:
        TimeoutError: it does not come.
    """
    began = time.perf_counter()
    while not path.is_file():
        if time.perf_counter() - began > PATIENCE:
            raise TimeoutError(f"'{path.name}' did not come")
        time.sleep(CHECK_EVERY)


def drop_scratch(where: Path, own: Waiting | None = None) -> None:
    """Removes what processes that were killed left in a twin's folder; `own` stays. Call it with the folder's lock."""
    for left in where.glob(f"{SCRATCH}*"):
        if own is None or left != own.folder:
            shutil.rmtree(left, ignore_errors=True)


class Waiting:
    """A child that imports what it needs while its parent does the same, and then waits for its job.

    Attributes:
        folder: for the job; process: the child.
    """

    def __init__(self, where: Path, threads: int) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix=SCRATCH, dir=where))
        self.process = begin(self.folder, threads, "--wait")

    def go(self) -> None:
        """The job is in the folder."""
        (self.folder / GO).touch()

    def end(self) -> None:
        """Ends the child, if it still runs, and removes its folder."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()
        shutil.rmtree(self.folder, ignore_errors=True)
