"""Commands side by side by real Dask workers: one is killed, one stopped, and a cluster of somebody else's is used."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import dgs
import pytest
from dgs.command_line import run
from dgs.command_line.main import build_parser
from dgs.command_line.synthesize_command import frame_tasks
from dgs.command_line.workers import Workers, words_of
from dgs.tests.command_line.scene import write_scene

ROOT = Path(dgs.__file__).parent
QUICK = ["--psf", "gaussian:2.5", "--preset", "draft", "--max-gaussians", "300", "--effects", "none"]


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """a, b and c with their cameras, and b's photos named again in a folder that holds none."""
    folder = tmp_path_factory.mktemp("sets")
    write_scene(folder / "scene")
    for name in "abc":
        shutil.copytree(folder / "scene" / "photos", folder / name)
    (folder / "empty").mkdir()
    (folder / "empty" / "notes.txt").write_text("no photos")
    return folder


def words(sets: Path, out: str, names: str, *more: str) -> list[str]:
    photos = [str(sets / name) for name in names.split()]
    return ["batch", *photos, "--out", str(sets / out), "--cameras", str(sets / "scene" / "model"), *QUICK, *more]


def started(arguments: list[str], new_session: bool = False) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(ROOT / "run_dgs.py"), *arguments, "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=new_session,
    )


def running(out: Path) -> dict[int, int]:
    """Processes with this folder in their command, and their parents.

    (The whole path: tests of other folders run beside these, and a part of a name is in their commands, too.)
    """
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if str(out) in (folder / "cmdline").read_text():
                found[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return found


def children_of(out: Path, wanted: int) -> dict[int, int]:
    """The trainings that write into the folder, and their workers, once there are so many."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        found = {pid: parent for pid, parent in running(out).items() if "reconstruct" in command_of(pid)}
        if len(found) >= wanted:
            return found
        time.sleep(0.1)
    raise AssertionError(f"no {wanted} trainings")


def command_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def said(process: subprocess.Popen[str]) -> dict[str, object]:
    out, errors = process.communicate(timeout=240)
    assert "Traceback" not in errors, errors
    last: dict[str, object] = json.loads(out.strip().splitlines()[-1])
    return last


def hows(process: subprocess.Popen[str]) -> list[str]:
    out, errors = process.communicate(timeout=240)
    assert "Traceback" not in errors, errors
    done = next(event for event in map(json.loads, out.splitlines()) if event["event"] == "done")
    return [line["how"] for line in done["result"]["sets"]]


def test_two_workers_make_the_twins_that_one_makes_and_one_that_fails_stops_no_other(sets: Path) -> None:
    process = started(words(sets, "two", "a empty c", "--workers", "2"))
    assert hows(process) == ["done", "failed", "done"] and process.returncode == 2
    assert run(words(sets, "alone", "a", "--threads", "1")) == 0
    made, alone = (sets / out / "a-twin" / "twin.ply" for out in ("two", "alone"))
    assert made.read_bytes() == alone.read_bytes()
    assert not running(sets / "two" / "a-twin")


def test_a_worker_that_is_killed_costs_what_it_was_at(sets: Path) -> None:
    process = started(words(sets, "killed", "a b", "--workers", "2"))
    trainings = children_of(sets / "killed", 2)
    victim, worker = next(iter(trainings.items()))
    os.kill(worker, signal.SIGKILL)
    end = time.monotonic() + 5
    while command_of(victim) and time.monotonic() < end:
        time.sleep(0.05)
    assert not command_of(victim), "the training of a dead worker goes on for nobody"
    assert hows(process) == ["done", "done"] and process.returncode == 0
    assert not running(sets / "killed")


def test_a_training_that_is_killed_is_asked_for_once_more(sets: Path) -> None:
    process = started(words(sets, "shot", "a", "--workers", "1"))
    victim = next(iter(children_of(sets / "shot", 1)))
    os.kill(victim, signal.SIGKILL)
    assert hows(process) == ["done"] and process.returncode == 0


def test_ctrl_c_keeps_what_is_done_and_begins_no_other(sets: Path) -> None:
    """As on a terminal the signal reaches every process of the group."""
    asked = words(sets, "stopped", "a b c", "--workers", "1")
    asked[asked.index("draft")] = "balanced"
    process = started(asked, new_session=True)
    children_of(sets / "stopped", 1)
    time.sleep(4)
    os.killpg(process.pid, signal.SIGINT)
    lines = hows(process)
    assert process.returncode == 130 and sorted(lines)[0] == "not begun" and set(lines) <= {"stopped", "not begun"}
    assert not running(sets / "stopped")


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[str]:
    """A scheduler and a worker that were started by somebody else, elsewhere, and know nothing of this program."""
    dask = str(Path(sys.executable).with_name("dask"))
    place = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen(
        [dask, "scheduler", "--no-dashboard", "--port", "0", "--scheduler-file", str(place)],
        stderr=subprocess.DEVNULL,
        cwd=tmp_path,
    )
    end = time.monotonic() + 60
    while not place.is_file() and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(0.5)
    address = json.loads(place.read_text())["address"]
    worker = subprocess.Popen(
        [dask, "worker", address, "--nthreads", "1", "--no-dashboard"], stderr=subprocess.DEVNULL, cwd=tmp_path
    )
    yield address
    for process in (worker, scheduler):
        process.terminate()
        process.wait(30)


def test_the_workers_of_a_cluster_need_nothing_of_ours_but_the_folders(sets: Path, cluster: str) -> None:
    process = started(words(sets, "cluster", "a", "--scheduler", cluster))
    assert hows(process) == ["done"] and process.returncode == 0


def test_a_cluster_that_is_not_there_is_one_line(
    sets: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dgs.command_line.workers._ANSWER", 2)
    assert run(words(sets, "nowhere", "a", "--scheduler", "tcp://127.0.0.1:9")) == 2
    line = capfd.readouterr().err.strip().splitlines()[-1]
    assert "127.0.0.1:9" in line and "dask scheduler" in line


def test_workers_share_the_cores() -> None:
    from dgs.core.machine import cores

    assert Workers(count=cores()).threads(None) == 1
    assert Workers(count=1).threads(None) == cores()
    assert Workers(count=4).threads(3) == 3
    assert Workers(address="tcp://x:1").threads(None) is None


def test_options_are_handed_on_and_those_of_the_giver_are_not(tmp_path: Path) -> None:
    asked = ["compare", "set", "--out", str(tmp_path), "--seeds", "2", "--only", "dgs", "--only", "plain", "--quick"]
    options = build_parser(asked).parse_args([*asked, "--workers", "2", "--resume", "--overwrite"])
    made = words_of(options, ("compare", "set"), ("dataset",))
    assert made[:2] == ["compare", "set"] and "--quick" in made and "--seeds=2" in made
    assert [word for word in made if word.startswith("--only")] == ["--only=dgs", "--only=plain"]
    assert not any(word.startswith(("--workers", "--resume", "--overwrite", "--dataset")) for word in made)


def test_photos_of_a_test_set_are_shared_out_as_the_same_set(tmp_path: Path) -> None:
    asked = ["synthesize", "--out", str(tmp_path), "--views", "9", "--size", "64x48", "--no-denoise", "--workers", "2"]
    asked += ["--medium", "shake:4..8", "--object-motion", "1,0,2"]
    options = build_parser(asked).parse_args(asked)
    tasks = frame_tasks(options)
    assert [task.words[-1] for task in tasks] == ["0-3", "4-7", "8-8"]
    again = build_parser(asked).parse_args(list(tasks[1].words))
    assert again.frames == range(4, 8)
    handed_on = {name: value for name, value in vars(again).items() if name not in ("frames", "workers")}
    assert handed_on == {name: vars(options)[name] for name in handed_on}
