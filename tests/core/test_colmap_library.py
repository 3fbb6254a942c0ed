"""COLMAP's library is loaded without what it does to signals."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CODE = """
import os, signal, sys, time
import run_dgs; run_dgs.mount_package()
{before}
from dgs.core.colmap_library import pycolmap
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(5)
print("it went on")
"""
HANDLER = "signal.signal(signal.SIGTERM, lambda number, frame: (print('asked to stop'), sys.exit(7)))"


@pytest.mark.parametrize(("before", "status", "said"), [(HANDLER, 7, "asked to stop\n"), ("", -signal.SIGTERM, "")])
def test_sigterm_is_what_it_was(before: str, status: int, said: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE.format(before=before)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (status, said, "")
