"""A program that steers the command line: cancel, pause, the end of its standard input, snapshots."""

import json
import subprocess
import sys
from pathlib import Path

import dgs
import pytest
from dgs.core.formats.ply import read_ply
from dgs.tests.command_line.scene import HEIGHT, SIGMA, WIDTH, write_scene
from PIL import Image

ROOT = Path(dgs.__file__).parent


@pytest.fixture
def start(tmp_path):
    write_scene(tmp_path)
    command = [
        sys.executable,
        str(ROOT / "run_dgs.py"),
        "reconstruct",
        str(tmp_path / "photos"),
        "--out",
        str(tmp_path / "out"),
        "--cameras",
        str(tmp_path / "model"),
        "--psf",
        f"gaussian:{SIGMA}",
        "--preset",
        "fine",
        "--max-gaussians",
        "2000",
        "--effects",
        "none",
        "--progress",
        "json",
        "--control",
        "--snapshots",
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8")
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def until(process, wanted):
    """Reads events up to the first that `wanted` accepts."""
    for line in process.stdout:
        event = json.loads(line)
        if wanted(event):
            return event
    raise AssertionError("the process ended before")


def trained(steps):
    return lambda event: event.get("stage") == "train" and event.get("done", 0) >= steps


def test_cancel_keeps_the_twin_and_snapshots_are_whole(start, tmp_path):
    picture = tmp_path / "out" / ".run" / "snapshot" / "picture.png"
    until(start, lambda event: picture.exists())
    assert Image.open(picture).size == (WIDTH, HEIGHT)
    start.stdin.write("cancel\n")
    start.stdin.flush()
    until(start, lambda event: event["event"] == "done")
    assert until(start, lambda event: event["event"] == "error")["status"] == 130
    assert start.wait(60) == 130
    assert len(read_ply(tmp_path / "out" / "twin.ply")) > 0
    assert len(read_ply(tmp_path / "out" / "snapshot" / "twin.ply")) > 0


def test_it_ends_with_its_standard_input(start):
    until(start, trained(10))
    start.stdin.close()
    assert start.wait(20) != 0


def test_a_paused_run_still_obeys(start):
    until(start, trained(10))
    for word in ("pause", "nonsense", "continue", "pause", "cancel"):
        start.stdin.write(word + "\n")
        start.stdin.flush()
    assert until(start, lambda event: event["event"] == "error")["status"] == 130
