"""Ctrl-C where nothing is saved: real processes, real signals."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import dgs
import pytest
from dgs.tests.command_line.scene import write_scene

ROOT = Path(dgs.__file__).parent


AFTERWARDS = """
import os, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # (a shell's background job ignores it)
import run_dgs; run_dgs.mount_package()
from dgs.command_line.interruption import GRACE, Interruption
with Interruption(saves=False):
    pass
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60)
except KeyboardInterrupt:
    time.sleep(4 * GRACE)
    print("the program's own again")
"""


def test_work_that_has_ended_is_not_watched():
    done = subprocess.run(
        [sys.executable, "-c", AFTERWARDS], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "the program's own again\n", "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_estimate_ends_soon_though_its_kernels_compile(tmp_path, number):
    write_scene(tmp_path)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}  # nothing is compiled yet
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, str(ROOT / "run_dgs.py"), "estimate", str(tmp_path / "photos")]
    process = subprocess.Popen(
        [*command, "--psf", "gaussian:2", "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    for line in process.stdout:
        event = json.loads(line)
        if event.get("name") == "probe":
            break
    time.sleep(2.0)
    assert process.poll() is None, "it still compiles"
    began = time.monotonic()
    process.send_signal(number)
    said = process.communicate(timeout=60)[1]
    assert time.monotonic() - began < 2.0
    assert process.returncode == 130
    assert said.strip() == "Stopped."
