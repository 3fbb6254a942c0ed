"""New photos into the twin from Blender: by button and from a watched folder; states on the timeline."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.formats.ply import read_ply  # noqa: E402
from dgs.core.twin.folder import TwinFolder  # noqa: E402
from dgs.dgs_addon.job import runner, watching  # noqa: E402
from dgs.dgs_addon.job.request import request_of, update_request  # noqa: E402
from dgs.dgs_addon.job.results import twin_of  # noqa: E402
from dgs.dgs_addon.job.watching import Watch, twins_photos  # noqa: E402
from dgs.dgs_addon.scene.states import STATE, add_states  # noqa: E402

ROOT = Path(dgs.__path__[0])
from dgs.studies.stability.fuzzed_state import write_twin  # noqa: E402
from dgs.tests.command_line.scene import SIGMA, write_scene  # noqa: E402

NEW = ("phöto 03.png", "phöto 05.png")


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """photos/ with a twin in out/, and two later photos in new/."""
    folder = tmp_path_factory.mktemp("update")
    write_scene(folder)
    (folder / "new").mkdir()
    for name in NEW:
        (folder / "photos" / name).rename(folder / "new" / name)
    dgs.register()
    scene = bpy.context.scene
    ask(scene, folder)
    runner.start(request_of("reconstruct", scene), Path(sys.executable), scene)
    assert runner.wait(120.0) and runner.current().state.phase == "done", runner.current().state
    dgs.unregister()
    return folder


def ask(scene: Any, folder: Path) -> None:
    settings = scene.dgs
    settings.photos, settings.out = str(folder / "photos"), str(folder / "out")
    settings.new_photos = str(folder / "new")
    settings.cameras, settings.model = "model", str(folder / "model")
    settings.medium, settings.sigma = "gaussian", SIGMA
    settings.preset, settings.max_gaussians, settings.holdout_every = "draft", 2000, 4
    settings.effects = "usual"  # trials take longer than these runs
    settings.threads = 1


@pytest.fixture
def scene(made: Path, tmp_path: Path) -> Any:
    shutil.copytree(made, tmp_path / "set")
    ask(bpy.context.scene, tmp_path / "set")
    return bpy.context.scene


def test_a_photo_is_taken_when_it_is_complete(tmp_path: Path) -> None:
    watch = Watch(tmp_path, {"old.png"})
    for name in ("old.png", "notes.txt", ".hidden.png"):
        (tmp_path / name).write_bytes(b"x")
    assert watch.complete() == [] and watch.complete() == []
    (tmp_path / "b.png").write_bytes(b"half")
    assert watch.complete() == []
    (tmp_path / "b.png").write_bytes(b"half and half")
    (tmp_path / "a.JPG").write_bytes(b"")
    assert watch.complete() == [], "still growing"
    assert watch.complete() == [], "an empty file is no photo yet"
    (tmp_path / "a.JPG").write_bytes(b"whole")
    assert watch.complete() == []
    ready = watch.complete()
    assert [path.name for path in ready] == ["a.JPG", "b.png"]
    watch.take(ready)
    assert watch.complete() == [] and watch.complete() == []
    shutil.rmtree(tmp_path)
    assert watch.complete() == []


def test_the_twin_grows_and_is_taken_back(scene: Any) -> None:
    out = Path(scene.dgs.out)
    before, record = (out / "twin.ply").read_bytes(), (out / "job.json").read_bytes()
    assert bpy.ops.dgs.add_results() == {"FINISHED"}
    count = len(twin_of(out, scene).data.vertices)
    assert not bpy.ops.dgs.rollback_twin.poll()
    assert bpy.ops.dgs.update_twin() == {"FINISHED"}
    assert runner.current().state.phase == "done"
    assert twins_photos(out, None) >= set(NEW)
    grown = read_ply(out / "twin.ply")
    assert (out / "twin.ply").read_bytes() != before
    assert len(twin_of(out, scene).data.vertices) == len(grown)
    assert (out / "job.json").read_bytes() == record, "the twin's own record stays"
    with pytest.raises(RuntimeError, match="no new photos"):
        bpy.ops.dgs.update_twin()
    assert bpy.ops.dgs.rollback_twin() == {"FINISHED"}
    assert (out / "twin.ply").read_bytes() == before
    assert len(twin_of(out, scene).data.vertices) == count


def test_a_twin_that_another_process_works_on_is_not_taken_back(tmp_path: Path) -> None:
    write_twin(tmp_path)
    out = tmp_path / "twin"
    bpy.context.scene.dgs.out = str(out)
    TwinFolder(out).keep_state()
    hold = (
        "import sys; sys.path.insert(0, sys.argv[1])\nimport run_dgs\nrun_dgs.mount_package()\n"
        "from pathlib import Path\nfrom dgs.core.lock import locked\n"
        "with locked(Path(sys.argv[2]), 'update'):\n    print('held', flush=True)\n    sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", hold, str(ROOT), str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        before = {path.name: path.read_bytes() for path in out.glob("*.*") if path.is_file()}
        with pytest.raises(RuntimeError, match=rf"Another process works on .*: process {other.pid}, update"):
            bpy.ops.dgs.rollback_twin()
        assert {path.name: path.read_bytes() for path in out.glob("*.*") if path.is_file()} == before
        assert len(TwinFolder(out).states()) == 1
        assert other.stdin is not None
        other.stdin.close()
    assert bpy.ops.dgs.rollback_twin() == {"FINISHED"} and not TwinFolder(out).states()


def test_a_watched_folder_starts_an_update(scene: Any) -> None:
    out = Path(scene.dgs.out)
    scene.dgs.watching = True
    assert bpy.app.timers.is_registered(watching._tick)
    assert watching.check(scene) is None, "the first check cannot say what is complete"
    job = watching.check(scene)
    assert job is not None and job.request.count == len(NEW)
    assert watching.check(scene) is None, "one job at a time"
    assert runner.wait(120.0) and job.state.phase == "done", job.state
    assert len(TwinFolder(out).states()) == 1
    assert [watching.check(scene) for _ in range(3)] == [None] * 3, "nothing new"
    scene.dgs.watching = False
    assert watching._tick() is None


def test_a_photo_that_cannot_be_used_is_tried_once(scene: Any) -> None:
    for name in NEW:
        (Path(scene.dgs.new_photos) / name).unlink()
    (Path(scene.dgs.new_photos) / "broken.png").write_bytes(b"\x89PNG broken")
    before = (Path(scene.dgs.out) / "twin.ply").read_bytes()
    scene.dgs.watching = True
    watching.check(scene)
    job = watching.check(scene)
    assert job is not None and runner.wait(60.0)
    assert job.state.phase == "failed" and "broken.png" in job.state.error
    assert [watching.check(scene) for _ in range(3)] == [None] * 3
    assert (Path(scene.dgs.out) / "twin.ply").read_bytes() == before
    scene.dgs.watching = False


def test_states_stand_on_the_timeline(scene: Any) -> None:
    out = Path(scene.dgs.out)
    TwinFolder(out).keep_state()
    (out / "update.json").write_text(json.dumps({"photos": ["a.png", "b.png"]}), "utf-8")
    TwinFolder(out).keep_state()
    scene.timeline_markers.new("state of play", frame=7)  # the user's own
    for _ in range(2):  # a second time in place of the first
        things = add_states(out, scene, first=1, frames=10)
    assert len(things) == 3
    assert len([o for o in scene.objects if STATE in o]) == 3
    assert {m.frame: m.name for m in scene.timeline_markers} == {
        7: "state of play",
        1: "out state 0",
        11: "out state 1: 2 new photos",
        21: "out state 2: 2 new photos",
    }
    for frame, shown in ((1, 0), (10, 0), (11, 1), (20, 1), (21, 2), (30, 2)):
        scene.frame_set(frame)
        assert [not thing.hide_viewport for thing in things] == [number == shown for number in range(3)], frame
        assert [not thing.hide_render for thing in things] == [number == shown for number in range(3)], frame


def test_the_request_names_the_new_photos_alone(scene: Any) -> None:
    out = Path(scene.dgs.out)
    photo = Path(scene.dgs.new_photos) / NEW[0]
    request = update_request(scene.dgs, [photo])
    assert request.home == out and request.out == out / "update"
    assert (out / "update" / "photos.txt").read_text("utf-8").split("\n")[:-1] == [str(photo.resolve())]
    assert request.arguments[:2] == ["update", str(out)]
