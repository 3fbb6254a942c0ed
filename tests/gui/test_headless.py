"""`blender -b -P run_dgs.py -- reconstruct ...` in a real Blender, whose Python has none of the engine's packages.

Asked for like the window's tests: DGS_WINDOW=sid or trixie.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import dgs
import pytest

ROOT = Path(dgs.__path__[0])
from dgs.tests.gui import window  # noqa: E402

pytestmark = pytest.mark.timeout(600)
SUITE = os.environ.get("DGS_WINDOW", "")


def test_blender_passes_the_work_on_to_the_engine(tmp_path: Path) -> None:
    reason = window.why_not(SUITE) if SUITE else "DGS_WINDOW names no Blender (see tests/gui/test_window.py)"
    if reason:
        pytest.skip(reason)
    subprocess.run(
        [
            sys.executable,
            str(ROOT / "run_dgs.py"),
            "synthesize",
            "--out",
            str(tmp_path / "set"),
            "--views",
            "10",
            "--size",
            "240x160",
            "--psf",
            "gaussian:1.5",
            "--samples",
            "2",
            "--progress",
            "none",
        ],
        check=True,
    )
    # The engine sees another /tmp than Blender does: the clone must lie where both see it.
    clone = tmp_path / "clone"
    shutil.copytree(ROOT, clone, ignore=shutil.ignore_patterns(".*", "data", "runs", "dist", "demo_output"))
    command = [
        "blender",
        "-b",
        "-P",
        str(clone / "run_dgs.py"),
        "--",
        "reconstruct",
        str(tmp_path / "set" / "photos"),
        "--cameras",
        str(tmp_path / "set" / "cameras"),
        "--out",
        str(tmp_path / "twin"),
        "--psf",
        "gaussian:1.5",
        "--preset",
        "draft",
        "--time-limit",
        "20s",
        "--progress",
        "none",
    ]
    window.run(SUITE, tmp_path, command, 300, window=False)
    report = json.loads((tmp_path / "twin" / "report.json").read_text("utf-8"))
    assert report["photos"]["registered"] == 10 and report["gaussians"] > 0
    assert (tmp_path / "twin" / "twin.ply").is_file()
