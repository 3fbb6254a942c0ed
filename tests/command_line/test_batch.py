"""Several sets of photos, one twin each: real processes, one of which fails, one of which is stopped."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import dgs
import pytest
from dgs.command_line import run
from dgs.command_line.batch_command import Line, add_arguments, child_arguments, result_folder, table
from dgs.tests.command_line.scene import write_scene

ROOT = Path(dgs.__file__).parent
QUICK = ["--psf", "gaussian:2.5", "--preset", "draft", "--max-gaussians", "300", "--effects", "none"]


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """a and c are good, b holds no photos; cameras stand beside them."""
    folder = tmp_path_factory.mktemp("sets")
    write_scene(folder / "scene")
    for name in ("a", "c"):
        shutil.copytree(folder / "scene" / "photos", folder / name)
    (folder / "b").mkdir()
    (folder / "b" / "notes.txt").write_text("no photos")
    return folder


def words(sets: Path, *more: str) -> list[str]:
    photos = [str(sets / name) for name in "abc"]
    return ["batch", *photos, "--out", str(sets / "out"), "--cameras", str(sets / "scene" / "model"), *QUICK, *more]


def test_a_set_that_fails_stops_no_other_and_finished_ones_are_not_made_twice(
    sets: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(words(sets)) == 2
    said = capfd.readouterr()
    lines = [line for line in said.out.splitlines() if line[:1] in "abc"]
    assert [line.split()[1] for line in lines] == ["done", "failed", "done"], said
    assert "holds no photos" in lines[1] and "9 of 9" in lines[0]
    assert said.err.strip().splitlines()[-1].startswith("1 of 3 failed") and "Traceback" not in said.err
    made = {name: (sets / "out" / f"{name}-twin" / "twin.ply").stat().st_mtime_ns for name in "ac"}
    shutil.copytree(sets / "scene" / "photos", sets / "b", dirs_exist_ok=True)
    began = time.monotonic()
    assert run(words(sets, "--progress", "json")) == 0
    took = time.monotonic() - began
    last = json.loads(capfd.readouterr().out.strip().splitlines()[-1])
    assert [line["how"] for line in last["result"]["sets"]] == ["done before", "done", "done before"], took
    assert last["result"]["sets"][1]["psnr"] > 10
    assert made == {name: (sets / "out" / f"{name}-twin" / "twin.ply").stat().st_mtime_ns for name in "ac"}


def test_it_stops_where_it_is_asked_to_and_goes_on(sets: Path) -> None:
    """Ctrl-C in the first training: the twin so far is kept, the second is not begun; then both are done."""
    out = sets / "stopped"
    asked = words(sets)
    asked[asked.index("--out") + 1] = str(out)
    del asked[2]  # two sets are enough
    asked[asked.index("draft")] = "balanced"
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "run_dgs.py"), *asked, "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event.get("event") == "advance" and event["stage"] == "train" and event["done"] > 5:
            break
    process.send_signal(signal.SIGINT)
    said, errors = process.communicate(timeout=120)
    last = [json.loads(line) for line in said.splitlines()]
    sets_said = next(event["result"]["sets"] for event in last if event["event"] == "done")
    assert [line["how"] for line in sets_said] == ["stopped", "not begun"]
    assert process.returncode == 130 and "Traceback" not in errors and not (out / "c-twin").exists()
    assert json.loads((out / "a-twin" / "report.json").read_text())["status"] == "cancelled"


def test_a_killed_batch_leaves_nobody_behind(sets: Path) -> None:
    asked = words(sets, "--again", "--progress", "json")
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "run_dgs.py"), *asked], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    next(line for line in process.stdout if '"stage"' in line)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert children
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    end = time.monotonic() + 20
    while any(Path(f"/proc/{child}/cmdline").exists() for child in children) and time.monotonic() < end:
        time.sleep(0.1)
    assert not any(Path(f"/proc/{child}/cmdline").exists() for child in children)


def test_two_sets_of_one_name_are_refused(sets: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a").mkdir()
    assert run(["batch", str(sets / "a"), str(tmp_path / "a"), "--out", str(tmp_path / "out")]) == 2
    assert "same results' folder" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_every_run_gets_what_was_given_for_all(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = parser.parse_args(["a", "--time-limit", "2m", "--refine-cameras", "--psf", "auto", "--threads", "2"])
    made = child_arguments(Path("a"), tmp_path / "a-twin", options, resumed=True)
    for word in (
        "--time-limit=120.0",
        "--refine-cameras",
        "--psf=auto",
        "--threads=2",
        "--resume",
        "--preset=balanced",
    ):
        assert word in made
    assert not any(word.startswith(("--overwrite", "--cameras", "--max-size")) for word in made)


def test_results_lie_beside_the_photos_as_in_blender(tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").touch()
    assert result_folder(tmp_path / "cup", None) == tmp_path / "cup-twin"
    assert result_folder(tmp_path / "clip.mp4", Path("/x")) == Path("/x/clip-twin")


def test_the_table_has_a_line_for_each() -> None:
    lines = table([Line("x/cup", "o", "done", "", "9 of 9", 28.123, 40000, 61.4), Line("y", "o", "failed", "Why.")])
    assert len(lines) == 3 and "28.12" in lines[1] and "40,000" in lines[1] and lines[2].endswith("Why.")
