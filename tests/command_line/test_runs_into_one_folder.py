"""A run into a folder that holds a twin: the old one stays until the new one is whole, and is kept; real processes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import dgs
import pytest
from dgs.command_line import run
from dgs.core.progress import Silent
from dgs.core.twin.begun import BEGUN, RUN
from dgs.core.twin.folder import TwinFolder
from dgs.core.twin.opened import open_files
from dgs.tests.command_line.scene import SIGMA, write_scene

ROOT = Path(dgs.__file__).parent
NEW = ("phöto 03.png", "phöto 05.png")
USUAL = ("--preset", "draft", "--max-gaussians", "800", "--holdout-every", "4", "--sh-degree", "0", "--threads", "1")
#: The command line with a checkpoint after every fifth of a second: trainings of tests are short.
HASTY = (
    "import sys; sys.path.insert(0, sys.argv.pop(1))\n"
    "import dataclasses, run_dgs\n"
    "run_dgs.mount_package()\n"
    "from dgs.core.training import run\n"
    "run.RUN = dataclasses.replace(run.RUN, checkpoint_seconds=0.2)\n"
    "sys.exit(run_dgs.main())\n"
)


def execute(*words: object) -> subprocess.CompletedProcess[str]:
    """A command, to its end."""
    return subprocess.run(
        [sys.executable, str(ROOT / "run_dgs.py"), *map(str, words), "--progress", "none"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        encoding="utf-8",
    )


def killed(*words: object, meanwhile: Callable[[int], None] | None = None) -> None:
    """A command, killed (-9) in its training, when it has a checkpoint; `meanwhile` is called with its process id."""
    out = Path(str(words[words.index("--out") + 1]))
    child = subprocess.Popen(
        [sys.executable, "-c", HASTY, str(ROOT), *map(str, words), "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    assert child.stdout is not None
    for line in child.stdout:
        event = json.loads(line)
        if event.get("stage") == "train" and (out / RUN / "checkpoint.npz").is_file():
            if meanwhile is not None:
                child.send_signal(signal.SIGSTOP)
                meanwhile(child.pid)
            child.kill()
            break
    child.communicate(timeout=60)
    assert child.returncode == -signal.SIGKILL


def content(folder: Path) -> dict[str, bytes]:
    """Every file that a user sees, by name."""
    files = {file.relative_to(folder).as_posix(): file for file in folder.rglob("*") if file.is_file()}
    return {name: file.read_bytes() for name, file in files.items() if not name.startswith(".")}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sets a/ (blurred, without two photos, which lie in new/) and b/ (sharp), and a/'s twin, first/ and updated."""
    folder = tmp_path_factory.mktemp("runs")
    write_scene(folder)
    (folder / "new").mkdir()
    (folder / "photos").rename(folder / "a")
    (folder / "sharp").rename(folder / "b")
    for name in NEW:
        (folder / "a" / name).rename(folder / "new" / name)
    done = execute("reconstruct", folder / "a", "--out", folder / "twin", *of_a(folder))
    assert done.returncode == 0, done.stderr
    shutil.copytree(folder / "twin", folder / "first")
    options = ("--cameras", folder / "model", "--share", "0.1", "--threads", "1")
    done = execute("update", folder / "twin", folder / "new", *options)
    assert done.returncode == 0, done.stderr
    return folder


def of_a(folder: Path) -> tuple[object, ...]:
    """Options for set a/."""
    return ("--cameras", folder / "model", "--psf", f"gaussian:{SIGMA}", *USUAL)


def of_b(folder: Path) -> tuple[object, ...]:
    """Options for set b/."""
    return ("--cameras", folder / "model", "--psf", "none", *USUAL)


@pytest.fixture
def twin(made: Path, tmp_path: Path) -> Path:
    """The updated twin, to be changed."""
    shutil.copytree(made / "twin", tmp_path / "twin")
    listed = tmp_path / "twin" / "photos.txt"
    listed.write_text(listed.read_text("utf-8").replace(str(made / "twin"), str(tmp_path / "twin")), "utf-8")
    return tmp_path / "twin"


def folders_of_photos(twin: Path) -> set[str]:
    """Where the twin's photos lie, as `next-view` and `update` read them."""
    return {photo.path.parent.name for photo in open_files(twin, Silent()).photos}


def test_a_run_over_another_twin_leaves_nothing_of_it_and_keeps_it(made: Path, twin: Path) -> None:
    """The old photo list, log and history stayed: the new twin was read with the old photos, and rolled back."""
    before = content(twin)
    done = execute("reconstruct", made / "b", "--out", twin, *of_b(made))
    assert done.returncode == 0, done.stderr
    assert folders_of_photos(twin) == {"b"}
    for gone in ("photos.txt", "twin.json", "update.json", "changes"):
        assert not (twin / gone).exists(), gone
    assert [path.name for path in TwinFolder(twin).states()] == ["000", "001"]
    assert TwinFolder(twin).own_states() == [], "they are another twin's"
    assert not (twin / RUN).exists()
    done = execute("update", twin, "--rollback")
    assert done.returncode == 0, done.stderr
    assert content(twin) == before
    assert folders_of_photos(twin) == {"a", "photos"}
    assert len(TwinFolder(twin).own_states()) == 1


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_a_killed_run_leaves_the_twin_and_can_be_resumed_with_the_same_photos_only(
    made: Path, twin: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    before = content(twin)

    def others(process: int) -> None:
        """No other command works on the folder meanwhile."""
        again = ["reconstruct", made / "b", "--out", twin, *of_b(made)]
        back = ["update", twin, "--rollback"]
        for command in (again, [*again, "--resume"], ["update", twin, made / "new"], back, ["next-view", twin]):
            assert run([*map(str, command), "--progress", "none"]) == 2, command
            assert f"process {process}, reconstruct" in capfd.readouterr().err, command

    killed("reconstruct", made / "b", "--out", twin, *of_b(made), meanwhile=others)
    assert content(twin) == before and folders_of_photos(twin) == {"a", "photos"}

    shutil.copytree(made / "b", tmp_path / "b")
    shutil.copy(made / "b" / "phöto 01.png", tmp_path / "b" / "phöto 02.png")
    done = execute("reconstruct", tmp_path / "b", "--out", twin, *of_b(made), "--resume")
    assert done.returncode == 2 and "'phöto 02.png' (or its mask) is not the photo" in done.stderr, done.stderr
    assert "without --resume" in done.stderr and done.stderr.count("\n") == 1

    moved = tmp_path / "moved"
    shutil.copytree(made / "model", moved)
    data = (moved / "images.bin").read_bytes()
    (moved / "images.bin").write_bytes(shifted(data))
    options = [moved if word == made / "model" else word for word in of_b(made)]
    done = execute("reconstruct", made / "b", "--out", twin, *options, "--resume")
    assert done.returncode == 2 and "other cameras" in done.stderr, done.stderr
    assert content(twin) == before

    done = execute("reconstruct", made / "b", "--out", twin, *of_b(made), "--resume")
    assert done.returncode == 0, done.stderr
    report = TwinFolder(twin).report()
    assert any("Going on from step" in note for note in report["notes"])
    assert folders_of_photos(twin) == {"b"} and len(TwinFolder(twin).states()) == 2


def shifted(images: bytes) -> bytes:
    """A COLMAP images.bin whose first camera stands elsewhere: its translation follows count, number and rotation."""
    at = 8 + 4 + 32
    (x,) = struct.unpack_from("<d", images, at)
    return images[:at] + struct.pack("<d", x + 0.5) + images[at + 8 :]


def test_a_finished_run_goes_on_without_a_state_of_its_own(made: Path, tmp_path: Path) -> None:
    """As the panel does to score a finished twin against sharp photos."""
    twin = tmp_path / "twin"
    shutil.copytree(made / "first", twin)
    before = content(twin)
    again = execute("reconstruct", made / "a", "--out", twin, *of_a(made), "--truth", made / "b", "--resume")
    assert again.returncode == 0, again.stderr
    after = content(twin)
    assert after["twin.ply"] == before["twin.ply"] and TwinFolder(twin).states() == []
    assert TwinFolder(twin).report()["heldout"]["sharp"]["psnr"] > 10
    other = execute("reconstruct", made / "b", "--out", twin, *of_a(made), "--resume")
    assert other.returncode == 2 and "is not the photo" in other.stderr
    assert content(twin) == after and not (twin / RUN).exists()


def test_a_failing_run_brings_back_the_one_that_was_cut_off(made: Path, twin: Path, tmp_path: Path) -> None:
    before = content(twin)
    (twin / RUN / "cameras").mkdir(parents=True)
    (twin / RUN / "checkpoint.npz").write_bytes(b"of an hour's work")
    (twin / RUN / BEGUN).touch()
    words = ["reconstruct", tmp_path / "no such photos", "--out", twin, *of_b(made), "--progress", "none"]
    assert run([str(word) for word in words]) == 2
    assert (twin / RUN / "checkpoint.npz").read_bytes() == b"of an hour's work"
    assert content(twin) == before
