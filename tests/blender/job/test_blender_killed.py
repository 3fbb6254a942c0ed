"""Blender itself is killed (-9) while a job runs: nothing of it goes on, the folder opens, the next Blender resumes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.formats.ply import read_ply  # noqa: E402
from dgs.dgs_addon.job import runner  # noqa: E402
from dgs.dgs_addon.job.record import Record, read_record  # noqa: E402
from dgs.tests.command_line.scene import SIGMA, write_scene  # noqa: E402

ROOT = Path(dgs.__path__[0])
MARK = "DGS_TEST_MARK"
#: A Blender without a window that starts or resumes a job, says what it hears, and waits to be killed.
BLENDER = """
import sys, run_dgs; run_dgs.mount_package()
import bpy, dgs
from pathlib import Path
from dgs.tests.blender.job.test_blender_killed import ask
dgs.register()
from dgs.dgs_addon.job import runner
from dgs.dgs_addon.job.request import request_of, resumed_request
scene, (folder, out) = bpy.context.scene, map(Path, sys.argv[1:])
ask(scene.dgs, folder, out)
record = runner.resumable(out)
request = request_of("reconstruct", scene) if record is None else resumed_request(record, out)
job = runner.start(request, Path(sys.executable), scene)
print("started", flush=True)
while job.state.alive:
    runner.wait(0.02)
    print(job.state.stage, len(job.state.marks), flush=True)
"""
#: A Blender that has asked the engine a question.
ASKING = """
import sys, time, run_dgs; run_dgs.mount_package()
import bpy, dgs
from pathlib import Path
from dgs.dgs_addon.questions import inspection
photos, out = map(Path, sys.argv[1:])
command = inspection.inspect_command(Path(sys.executable), photos / "photos", out, photos / "model")
inspection.effects.ask((), "Inspecting", command)
while inspection.effects.errand._process is None:
    time.sleep(0.01)
print("started", flush=True)
time.sleep(60)
"""
#: What is waited for before the kill, and at most how many seconds after it the kill comes.
MOMENTS = (("started", 1.0), ("train 1", 2.0))


def ask(settings: Any, folder: Path, out: Path) -> None:
    """Settings of a small twin with given cameras, whose training outlasts any of `MOMENTS` on a quick machine."""
    settings.photos, settings.out = str(folder / "photos"), str(out)
    settings.cameras, settings.model = "model", str(folder / "model")
    settings.medium, settings.sigma, settings.threads = "gaussian", SIGMA, 1
    settings.preset, settings.max_gaussians, settings.holdout_every = "balanced", 1000, 4
    settings.effects = "usual"  # trials take longer than these runs


@pytest.fixture
def scene() -> Iterator[Any]:
    dgs.register()
    yield bpy.context.scene
    dgs.unregister()


def processes(mark: str) -> list[int]:
    """All processes with this mark in their environment, whoever is their parent by now."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:  # gone meanwhile, or somebody else's
                continue
    return found


def killed(folder: Path, out: Path, moment: str, delay: float, script: str = BLENDER) -> str:
    """Starts a Blender, kills it at a moment, and returns the mark of all that it started."""
    mark = uuid.uuid4().hex
    blender = subprocess.Popen(
        [sys.executable, "-c", script, str(folder), str(out)],
        cwd=ROOT,
        env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert blender.stdout is not None
    heard = next((line for line in blender.stdout if line.startswith(moment)), None)
    assert heard is not None, f"it ended before '{moment}'"
    time.sleep(delay)
    os.kill(blender.pid, signal.SIGKILL)
    assert blender.wait(10) == -signal.SIGKILL
    return mark


def orphans(mark: str, seconds: float = 10.0) -> list[int]:
    """What still works so many seconds after its Blender has gone."""
    end = time.monotonic() + seconds
    while processes(mark) and time.monotonic() < end:
        time.sleep(0.02)
    return processes(mark)


def files(out: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


def interrupted_record(out: Path, seconds: float = 10.0) -> Record | None:
    """The record, as soon as it says that its job was interrupted: a process whose memory is gone may be a while in
    its exit on a busy machine."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        record = read_record(out)
        if record is not None and record.interrupted:
            return record
        time.sleep(0.02)
    return None


@pytest.mark.timeout(600)
def test_nothing_goes_on_without_blender_and_the_next_one_resumes(scene: Any, tmp_path: Path) -> None:
    write_scene(tmp_path)
    out, moments = tmp_path / "out", random.Random(1)
    for moment, latest in MOMENTS:
        mark = killed(tmp_path, out, moment, moments.uniform(0.0, latest))
        assert not orphans(mark), f"{moment}: an orphan works on"
        there = files(out)
        time.sleep(0.3)
        assert files(out) == there, f"{moment}: somebody still writes"
        record = interrupted_record(out)
        assert record is not None, moment
        assert runner.resumable(out) == record
        assert not list(out.glob("twin.ply")) or len(read_ply(out / "twin.ply"))
    scene.dgs.out = str(out)  # the next Blender has only the folder
    assert bpy.ops.dgs.resume_job() == {"FINISHED"}
    assert runner.current().state.phase == "done" and len(read_ply(out / "twin.ply")) > 0
    assert runner.resumable(out) is None


def test_no_question_goes_on_without_the_blender_that_asked(tmp_path: Path) -> None:
    write_scene(tmp_path)
    assert not orphans(killed(tmp_path, tmp_path / "inspection", "started", 0.2, ASKING))
    assert not (tmp_path / "inspection" / "inspection.json").exists()
