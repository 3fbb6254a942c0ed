"""The life of a job with the real engine: done, cancelled, killed, orphaned, resumed."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.formats.ply import read_ply  # noqa: E402
from dgs.dgs_addon.job import runner  # noqa: E402
from dgs.dgs_addon.job.record import read_record  # noqa: E402
from dgs.dgs_addon.job.request import request_of, resumed_request  # noqa: E402
from dgs.dgs_addon.job.results import FOLDER, SCORE, SETTINGS  # noqa: E402
from dgs.dgs_addon.questions import exact  # noqa: E402
from dgs.dgs_addon.scene.next_views import ORDER  # noqa: E402
from dgs.dgs_addon.scene.twin import is_twin  # noqa: E402
from mathutils import Matrix  # noqa: E402

ROOT = Path(dgs.__path__[0])
from dgs.tests.command_line.scene import SIGMA, write_scene  # noqa: E402


@pytest.fixture(scope="module")
def photo_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photo set") / "ümläut"
    write_scene(folder)
    return folder


@pytest.fixture
def scene(photo_set: Path, tmp_path: Path) -> Iterator[object]:
    """A scene whose settings ask for a quick twin with given cameras."""
    dgs.register()
    settings = bpy.context.scene.dgs
    settings.photos, settings.out = str(photo_set / "photos"), str(tmp_path / "out")
    settings.cameras, settings.model = "model", str(photo_set / "model")
    settings.medium, settings.sigma = "gaussian", SIGMA
    settings.preset, settings.max_gaussians, settings.holdout_every = "draft", 2000, 4
    settings.effects = "usual"  # trials take longer than these runs
    yield bpy.context.scene
    dgs.unregister()


def begin(scene: object, **changes: object) -> runner.Job:
    """Starts a job and does not wait for it, as with a window."""
    for name, value in changes.items():
        setattr(scene.dgs, name, value)
    return runner.start(request_of("reconstruct", scene), Path(sys.executable), scene)


def until(true: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, runner.current().state
        runner.wait(0.02)


def pixels(image: object) -> np.ndarray:
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], 4)[..., :3]


def exact_view_is_the_engines(scene: object, renders: Path) -> None:
    """The panel's picture is the one that the run scored, wherever the twin was moved; the medium blurs it."""
    name = Path(scene.camera["dgs_photo"]).stem
    wanted = pixels(bpy.data.images.load(str(renders / f"{name}.png")))
    twin = scene.camera.parent
    twin.matrix_world = (
        Matrix.Translation((3, 1, -2)) @ Matrix.Rotation(0.7, 4, "Z") @ Matrix.Scale(2.5, 4) @ (twin.matrix_world)
    )
    bpy.context.view_layer.update()
    assert bpy.ops.dgs.exact_view() == {"FINISHED"}
    sharp = pixels(bpy.data.images[exact.IMAGE])
    assert sharp.shape == wanted.shape
    inside = (slice(10, -10), slice(10, -10))  # the run put the photos' mean behind it, this one nothing
    assert np.abs(sharp - wanted)[inside].mean() < 0.01
    scene.dgs.view_kind = "medium"
    assert bpy.ops.dgs.exact_view() == {"FINISHED"}
    blurred = pixels(bpy.data.images[exact.IMAGE])
    assert np.abs(np.diff(blurred, axis=1)).mean() < 0.7 * np.abs(np.diff(sharp, axis=1)).mean()
    scene.dgs.medium = "auto-each"  # the twin holds the medium it was made with
    assert bpy.ops.dgs.exact_view() == {"FINISHED"}
    assert np.abs(pixels(bpy.data.images[exact.IMAGE]) - blurred).max() < 0.02
    scene.dgs.medium = "gaussian"


@pytest.mark.timeout(900)  # a run, three exact views and a search for views, on a machine that may be busy
def test_from_photos_to_a_twin_without_a_window(scene: object, tmp_path: Path) -> None:
    assert bpy.ops.dgs.optimize() == {"FINISHED"}
    job = runner.current()
    assert job.state.phase == "done" and job.state.error == ""
    assert [mark.step for mark in job.state.marks][-1] == 450  # a draft's 300, half as many more for so little blur
    assert job.state.marks[-1].psnr > job.state.marks[0].loss
    twin = next(thing for thing in scene.objects if is_twin(thing))
    assert bpy.context.object == twin
    assert len(twin.data.vertices) == len(read_ply(tmp_path / "out" / "twin.ply"))
    assert twin[FOLDER] == str(tmp_path / "out")
    assert json.loads(twin[SETTINGS])["run"]["psf"] == f"gaussian:{SIGMA:g}"
    assert json.loads(twin[SCORE])["degraded"]["psnr"] > 15
    assert scene.camera is not None and scene.camera.parent == twin
    assert scene.render.engine == "DESCATTER"
    assert read_record(tmp_path / "out").phase == "done"
    assert runner.resumable(tmp_path / "out") is None
    exact_view_is_the_engines(scene, tmp_path / "out" / "renders")
    # Once more: what is there is replaced, not doubled.
    count = len(bpy.data.objects)
    assert bpy.ops.dgs.add_results() == {"FINISHED"}
    assert len(bpy.data.objects) == count
    assert bpy.ops.dgs.suggest_next_views(count=2) == {"FINISHED"}
    suggested = sorted((thing for thing in scene.objects if ORDER in thing), key=lambda thing: thing[ORDER])
    assert [thing[ORDER] for thing in suggested] == [1, 2] and all(thing.parent == twin for thing in suggested)
    # The exact view lies in the file, and says when it is one no more.
    bpy.context.view_layer.update()
    assert exact.is_outdated(twin, scene)  # (another medium was asked for last)
    assert bpy.ops.dgs.exact_view() == {"FINISHED"}
    before = pixels(scene.dgs.exact_view)
    assert not exact.is_outdated(twin, scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    scene = bpy.context.scene
    assert np.array_equal(pixels(scene.dgs.exact_view), before) and not list(Path(bpy.app.tempdir).glob("descatter-*"))
    assert not exact.is_outdated(scene.camera.parent, scene)
    scene.camera.parent.data.attributes["position"].data.foreach_set(
        "vector", np.zeros(3 * len(scene.camera.parent.data.vertices), np.float32)
    )
    assert exact.is_outdated(scene.camera.parent, scene)


def test_cancel_keeps_what_was_done_and_resume_ends_it(scene: object, tmp_path: Path) -> None:
    job = begin(scene, preset="fine", add_when_done=False)
    with pytest.raises(RuntimeError, match="A job is running"):
        bpy.ops.dgs.optimize()
    until(lambda: job.state.marks)
    assert not read_record(tmp_path / "out").interrupted  # as another Blender would see it
    runner.pause(True)
    assert job.state.phase == "paused"
    assert bpy.ops.dgs.cancel_job() == {"FINISHED"}
    until(lambda: not runner.busy())
    assert job.state.phase == "cancelled" and job.state.error == ""
    done = job.state.marks[-1].step
    assert 0 < done < 4000 and len(read_ply(tmp_path / "out" / "twin.ply")) > 0
    assert runner.resumable(tmp_path / "out").phase == "cancelled"
    assert bpy.ops.dgs.resume_job.poll()
    record = read_record(tmp_path / "out")
    again = runner.start(resumed_request(record, tmp_path / "out"), Path(sys.executable), scene)
    until(lambda: again.state.marks)
    assert again.state.marks[0].step >= done
    runner.cancel()
    until(lambda: not again.state.alive)


def test_a_killed_engine_is_explained_and_costs_little(scene: object, tmp_path: Path) -> None:
    job = begin(scene)
    until(lambda: job.state.marks)
    os.kill(job.worker.pid, signal.SIGKILL)
    until(lambda: not runner.busy())
    assert job.state.phase == "failed"
    assert "SIGKILL" in job.state.error and "Resume" in job.state.error
    assert bpy.ops.dgs.resume_job() == {"FINISHED"}
    assert runner.current().state.phase == "done"


def test_another_file_lets_the_job_go_on_and_gets_nothing_of_it(scene: object, tmp_path: Path) -> None:
    job = begin(scene)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    until(lambda: not runner.busy())
    assert job.state.phase == "done"
    assert not any(is_twin(thing) for thing in bpy.data.objects)
    # The file that asked can still have it.
    bpy.context.scene.dgs.out = str(tmp_path / "out")
    assert bpy.ops.dgs.add_results() == {"FINISHED"}


def test_what_the_engine_refuses_is_said(scene: object, photo_set: Path, tmp_path: Path) -> None:
    job = begin(scene, model=str(photo_set / "photos"))
    until(lambda: not runner.busy())
    assert job.state.phase == "failed" and "camera" in job.state.error.lower()
    assert "Traceback" not in job.log.read_text("utf-8")


def test_an_engine_that_cannot_be_started_is_said(scene: object, tmp_path: Path) -> None:
    job = runner.start(request_of("reconstruct", scene), tmp_path / "no python", scene)
    until(lambda: not runner.busy())
    assert job.state.phase == "failed" and "cannot be started" in job.state.error


def test_a_live_twin_is_shown_while_it_is_optimized(scene: object, tmp_path: Path) -> None:
    # Without a window nothing is shown; this is what a window shows.
    job = begin(scene, preset="fine")
    job.snapshots.__init__(tmp_path / "out", live=True, most=1000)
    until(lambda: any(is_twin(thing) for thing in scene.objects))
    assert job.state.alive
    runner.cancel()
    until(lambda: not runner.busy())
    assert sum(is_twin(thing) for thing in scene.objects) == 1


def test_another_file_may_be_loaded_while_the_twin_comes_in(scene: object) -> None:
    job = begin(scene, preset="draft")
    end = time.monotonic() + 300.0  # (a busy machine)
    while job.finishing is None and time.monotonic() < end:
        runner._drain()
        time.sleep(0.02)
    runner._drain()  # the first piece: the nodes
    assert job.finishing is not None and bpy.data.node_groups
    assert not any(is_twin(thing) for thing in scene.objects)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert runner.wait(5) and not runner.busy()
    assert job.state.phase == "done" and not bpy.data.objects


def test_switching_the_add_on_off_ends_the_job(scene: object) -> None:
    job = begin(scene, preset="fine")
    until(lambda: job.state.marks)
    dgs.unregister()
    assert runner.current() is None and job.worker.join(5)
    dgs.register()


def test_cameras_of_these_photos_are_taken_over(scene: object, tmp_path: Path) -> None:
    request = replace(request_of("reconstruct", scene), reuse_cameras=True)
    assert request.command(Path("python"))[-1] == "--keep-cameras"
    assert replace(request, resume=True).command(Path("python"))[-1] == "--resume"
