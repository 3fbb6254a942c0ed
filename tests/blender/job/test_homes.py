"""A finished twin always has a home: its scene, whatever became of it meanwhile, or a notice with a button."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.colmap import write_model  # noqa: E402
from dgs.core.formats.ply import write_ply  # noqa: E402
from dgs.core.views import SparsePoints  # noqa: E402
from dgs.dgs_addon.job import pictures, runner  # noqa: E402
from dgs.dgs_addon.job.request import Request  # noqa: E402
from dgs.dgs_addon.job.results import FOLDER, twin_of  # noqa: E402
from dgs.dgs_addon.scene.scene_cameras import PHOTO  # noqa: E402
from dgs.dgs_addon.scene.twin import is_twin  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402

#: A program that reports as the engine does: it optimizes until the folder holds a file 'go', then has its twin.
ENGINE = """
import json, shutil, sys, time
from pathlib import Path
out = Path(sys.argv[1])
say = lambda **event: print(json.dumps(event), flush=True)
say(event="stage", name=sys.argv[2], total=10)
say(event="advance", stage="train", done=1, total=10, seconds_left=1.0, loss=0.5, heldout_psnr=20.0)
while not (out / "go").exists():
    time.sleep(0.02)
shutil.copyfile(out / "made.ply", out / "twin.ply")
say(event="done", result={"twin": "twin.ply"})
"""


@pytest.fixture
def scene(tmp_path: Path, cloud: GaussianCloud) -> Iterator[Any]:
    """A scene with photos, whose results' folder holds all that a finished run leaves but the twin."""
    pytest.importorskip("pycolmap")
    dgs.register()
    out = tmp_path / "photos-twin"
    (tmp_path / "photos").mkdir()
    out.mkdir()
    write_ply(out / "made.ply", cloud)
    write_cameras(out, "abc")
    bpy.context.scene.dgs.photos = str(tmp_path / "photos")
    bpy.context.scene.name = "Workshop"
    yield bpy.context.scene
    dgs.unregister()


def write_cameras(out: Path, names: str) -> None:
    cameras = {
        f"{name}.png": Camera(f"{name}.png", 64, 48, 50, 50, 32, 24, np.eye(3), np.array([0.1 * i, 0.0, 0.0]))
        for i, name in enumerate(names)
    }
    points = SparsePoints(np.array([[0.0, 0, 5], [1, 0, 5]]), np.full((2, 3), 128, np.uint8))
    (out / "cameras").mkdir(exist_ok=True)
    write_model(out / "cameras", cameras, points)


def begin(scene: Any, out: Path, stage: str = "train") -> runner.Job:
    script = out / "engine.py"
    script.write_text(ENGINE, "utf-8")
    photos = out.with_name(out.name.removesuffix("-twin"))
    request = Request("reconstruct", photos, out, [str(script), str(out), stage], program=(sys.executable,))
    job = runner.start(request, Path(sys.executable), scene)
    until(lambda: job.state.stage)
    return job


def until(true: Callable[[], object], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, runner.current().state
        runner.wait(0.02)


def finish(job: runner.Job) -> None:
    (job.request.out / "go").touch()
    until(lambda: not runner.busy())
    assert job.state.phase == "done", job.state.error


def twins() -> list[Any]:
    return [thing for thing in bpy.data.objects if is_twin(thing)]


def test_a_scene_may_be_renamed_while_its_twin_is_made(scene: Any, tmp_path: Path) -> None:
    job = begin(scene, tmp_path / "photos-twin")
    scene.name = "Atelier"
    other = bpy.data.scenes.new("Workshop")  # it has the name by now, and no photos
    finish(job)
    assert [thing.users_scene[0] for thing in twins()] == [scene] and not other.objects
    assert not job.homeless and scene.camera[PHOTO] == "a.png"


@pytest.mark.parametrize("lost", ["photos", "scene", "file"])
def test_a_twin_whose_scene_is_lost_waits_for_the_button(scene: Any, tmp_path: Path, lost: str) -> None:
    job = begin(scene, tmp_path / "photos-twin")
    if lost == "photos":  # as an undo leaves it
        scene.dgs.photos = ""
    elif lost == "scene":
        bpy.data.scenes.new("Empty")
        bpy.data.scenes.remove(scene)
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    finish(job)
    assert not twins() and job.homeless
    (button,) = drawn(panels.DGS_PT_main).buttons["dgs.add_results"]
    assert button.folder == str(tmp_path / "photos-twin")
    assert bpy.ops.dgs.add_results(folder=str(tmp_path / "photos-twin")) == {"FINISHED"}
    assert [thing[FOLDER] for thing in twins()] == [str(tmp_path / "photos-twin")] and not job.homeless


def test_a_notice_can_be_dismissed(scene: Any, tmp_path: Path) -> None:
    job = begin(scene, tmp_path / "photos-twin")
    scene.dgs.photos = ""
    finish(job)
    assert bpy.ops.dgs.dismiss(notice="TWIN") == {"FINISHED"}
    assert not job.homeless and not bpy.ops.dgs.add_results.poll()


def test_a_file_that_is_opened_again_takes_its_twin(scene: Any, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    job = begin(scene, tmp_path / "photos-twin")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    finish(job)
    assert len(twins()) == 1 and not job.homeless


def test_who_does_not_want_the_twin_in_the_scene_is_not_asked(scene: Any, tmp_path: Path) -> None:
    scene.dgs.add_when_done = False
    job = begin(scene, tmp_path / "photos-twin")
    scene.dgs.photos = ""
    finish(job)
    assert not job.homeless and not twins()


def test_a_job_belongs_to_its_scene_alone(scene: Any, tmp_path: Path) -> None:
    job = begin(scene, tmp_path / "photos-twin")
    other = bpy.data.scenes.new("Other")
    assert runner.belongs(job, scene) and not runner.belongs(job, other)
    scene.name = "Atelier"
    assert runner.scene_name(job) == "Atelier"
    until(lambda: job.state.marks)
    mine, others = (drawn(panels.DGS_PT_main, scene=shown) for shown in (scene, other))
    assert "20.00 dB" in mine.words and "Atelier" not in mine.words and "dgs.pause_job" in mine.buttons
    assert "20.00 dB" not in others.words and "Atelier" in others.words and "dgs.cancel_job" in others.buttons
    finish(job)
    mine, others = (drawn(panels.DGS_PT_optimize, scene=shown) for shown in (scene, other))
    assert "Done in" in mine.words and "20.00 dB" in mine.words
    assert "Done in" not in others.words and "20.00 dB" not in others.words
    # The picture of the job before, as a window leaves it, is not the next one's twin so far.
    pictures._shown.job, pictures._shown.drawn = job, True
    assert pictures.shows(job)
    again = begin(scene, tmp_path / "photos-twin")
    assert not pictures.shows(again)
    finish(again)


@pytest.mark.parametrize("stage", ["compile", "photos"])
def test_a_job_that_has_nothing_to_keep_ends_soon(scene: Any, tmp_path: Path, stage: str) -> None:
    """The compiler hears nothing for half a minute; this program hears nothing at all."""
    job = begin(scene, tmp_path / "photos-twin", stage)
    began = time.monotonic()
    assert bpy.ops.dgs.cancel_job() == {"FINISHED"}
    until(lambda: not runner.busy(), 10)
    assert time.monotonic() - began < 5 and job.state.phase == "cancelled"


def add_twin(scene: Any, out: Path) -> Any:
    if not (out / "twin.ply").exists():
        (out / "made.ply").replace(out / "twin.ply")
    assert bpy.ops.dgs.add_results() == {"FINISHED"}
    return twin_of(out, scene)


def test_linked_duplicates_live_through_a_new_twin_and_show_it(scene: Any, tmp_path: Path) -> None:
    out = tmp_path / "photos-twin"
    twin = add_twin(scene, out)
    linked, own = twin.copy(), twin.copy()  # Alt-D and Shift-D
    own.data = twin.data.copy()
    plain = bpy.data.objects.new("points", twin.data)
    for thing in (linked, own, plain):
        scene.collection.objects.link(thing)
    names, mesh = {thing.name for thing in bpy.data.objects}, twin.data.name
    assert add_twin(scene, out) == twin
    assert {thing.name for thing in bpy.data.objects} == names
    assert linked.data == plain.data == twin.data and twin.data.name == mesh and own.data != twin.data
    assert len(bpy.data.meshes) == 3, "of both twins and the points: no mesh is left over"


def test_cameras_stay_the_same_objects_and_take_nothing_along(scene: Any, tmp_path: Path) -> None:
    out = tmp_path / "photos-twin"
    twin = add_twin(scene, out)
    first, last = (next(o for o in scene.objects if o.get(PHOTO) == f"{name}.png") for name in "ac")
    shots = bpy.data.collections.new("Shots")
    scene.collection.children.link(shots)
    shots.objects.link(last)
    mine = bpy.data.objects.new("mine", None)
    first.users_collection[0].objects.link(mine)
    elsewhere = bpy.data.scenes.new("Elsewhere")
    elsewhere.dgs.photos = scene.dgs.photos
    before = [collection.name for collection in bpy.data.collections]
    scene.camera, first.name = last, "my favourite"
    scene.render.resolution_x = 1111
    write_cameras(out, "ab")
    with bpy.context.temp_override(scene=elsewhere):
        add_twin(elsewhere, out)  # takes nothing out of the other scene
    assert set(before) <= {collection.name for collection in bpy.data.collections} and first.name == "my favourite"
    assert add_twin(scene, out) == twin
    photos = sorted(str(o[PHOTO]) for o in first.users_collection[0].objects if PHOTO in o)
    assert photos == ["a.png", "b.png"] and first.parent == twin
    assert scene.camera == last and last.name in shots.objects and scene.render.resolution_x == 1111
    assert mine.name in scene.objects


def test_cameras_of_a_deleted_twin_belong_to_the_next(scene: Any, tmp_path: Path) -> None:
    out = tmp_path / "photos-twin"
    bpy.data.objects.remove(add_twin(scene, out))
    bpy.ops.dgs.add_results()
    cameras = [thing for thing in scene.objects if PHOTO in thing]
    assert len(cameras) == 3 and all(camera.parent == twin_of(out, scene) for camera in cameras)
    assert len(bpy.data.cameras) == 3


def test_a_deleted_live_twin_stays_away_until_it_is_finished(scene: Any, tmp_path: Path, cloud: GaussianCloud) -> None:
    out = tmp_path / "photos-twin"
    job = begin(scene, out)
    job.snapshots.live = True
    for deleted in (False, True):
        job.cloud, job.unseen, job.live_pace._shown = cloud, True, None
        until(lambda: not job.unseen)
        assert len(twins()) == (0 if deleted else 1)
        for twin in twins():
            bpy.data.objects.remove(twin)
    finish(job)
    assert len(twins()) == 1
    assert json.loads((out / "job.json").read_text("utf-8"))["phase"] == "done"


def test_a_twin_that_is_edited_is_left_alone_until_edit_mode_is_left(
    scene: Any, tmp_path: Path, cloud: GaussianCloud
) -> None:
    """Blender keeps what is edited elsewhere: a mesh that took its place would lose it, or end Blender."""
    twin = add_twin(scene, tmp_path / "photos-twin")
    write_ply(tmp_path / "photos-twin" / "made.ply", cloud)
    bpy.context.view_layer.objects.active = twin
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.delete(type="VERT")
    with pytest.raises(RuntimeError, match="in Edit Mode"):
        bpy.ops.dgs.add_results()
    job = begin(scene, tmp_path / "photos-twin")
    (tmp_path / "photos-twin" / "go").touch()
    until(lambda: not runner.running())
    for _ in range(20):
        runner._drain()
    assert runner.busy() and twin.data.is_editmode and job.state.phase == "done"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(twin.data.vertices) == 0
    finish(job)
    assert len(twin.data.vertices) == len(cloud) and twins() == [twin]


def test_a_new_state_of_a_twin_whose_transform_was_applied_stands_where_it_stood(
    scene: Any, tmp_path: Path, cloud: GaussianCloud
) -> None:
    twin = add_twin(scene, tmp_path / "photos-twin")
    write_ply(tmp_path / "photos-twin" / "made.ply", cloud)
    twin.location.x += 3.0
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = twin
    assert bpy.ops.dgs.apply_transform() == {"FINISHED"}
    stood = [tuple(vertex.co) for vertex in twin.data.vertices]
    job = begin(scene, tmp_path / "photos-twin")
    finish(job)
    np.testing.assert_allclose([tuple(vertex.co) for vertex in twin.data.vertices], stood, atol=1e-5)
