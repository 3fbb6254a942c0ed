"""Orders to an engine that has died end neither the thread that gives them nor the process: some Blenders take
SIGPIPE as it comes, where Python would ignore it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import dgs
import pytest

pytest.importorskip("bpy")

#: An engine that hears nothing and ends, in a process that does not ignore SIGPIPE.
BLENDER = """
import signal, sys, time
from pathlib import Path
import run_dgs; run_dgs.mount_package()
from dgs.dgs_addon.job.worker import Ended, Worker
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
deaf = "import os, sys, time; os.close(0); print(1, flush=True); time.sleep({seconds})"
for seconds in (0.0, 0.5):
    worker = Worker([sys.executable, "-c", deaf.format(seconds=seconds)], Path(sys.argv[1]))
    worker.send("pause")
    worker.start()
    while worker.pid is None:
        time.sleep(0.01)
    time.sleep(0.3)
    for _ in range(3):
        worker.send("cancel")
    worker.join(20.0)
    said = worker.events.get(timeout=1.0)
    assert said == Ended(0), said
assert signal.SIGPIPE not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
print("alive", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_orders_to_the_dead_end_nobody(tmp_path: Path) -> None:
    command = [sys.executable, "-c", BLENDER, str(tmp_path / "log.txt")]
    ended = subprocess.run(command, cwd=Path(dgs.__path__[0]), capture_output=True, text=True, check=False)
    assert ended.stdout.endswith("alive\n"), (ended.returncode, ended.stderr)
