"""The parts of a job that need no engine: events, endings, records, curves, the request."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.errors import DgsError, FormatError  # noqa: E402
from dgs.dgs_addon.job import preview  # noqa: E402
from dgs.dgs_addon.job.record import NAME, Record, read_record  # noqa: E402
from dgs.dgs_addon.job.request import request_of  # noqa: E402
from dgs.dgs_addon.job.state import JobState, Mark, duration_text, ending  # noqa: E402
from dgs.dgs_addon.photos import forget, photo_folder  # noqa: E402


@pytest.fixture
def settings(tmp_path: Path) -> Iterator[object]:
    dgs.register()
    photos = tmp_path / "photos"
    photos.mkdir()
    for number in range(4):
        image = bpy.data.images.new(f"{number}", 24, 16)
        image.filepath_raw, image.file_format = str(photos / f"{number}.png"), "PNG"
        image.save()
    bpy.context.scene.dgs.photos = str(photos)
    yield bpy.context.scene.dgs
    dgs.unregister()


def test_events_change_the_state() -> None:
    state = JobState()
    assert state.title == "Starting the engine" and state.alive
    state.apply({"event": "stage", "name": "train", "total": 100})
    state.apply({"event": "advance", "stage": "train", "done": 25, "total": 100, "seconds_left": 7.5, "loss": 0.5})
    assert state.title == "Optimizing" and state.factor == 0.25 and state.seconds_left == 7.5
    assert state.marks == [Mark(25, 0.5, None)]
    state.apply({"event": "something new"})
    state.apply({"event": "error", "text": "no"})
    state.end("failed", state.error)
    assert not state.alive and state.error == "no"


@pytest.mark.parametrize(
    ("status", "said", "cancelled", "phase", "word"),
    [
        (0, "", False, "done", ""),
        (130, "Stopped", True, "cancelled", ""),
        (-signal.SIGKILL, "", True, "cancelled", ""),
        (-signal.SIGKILL, "", False, "failed", "SIGKILL"),
        (-signal.SIGSEGV, "", False, "failed", "SIGSEGV"),
        (-250, "", False, "failed", "signal 250"),
        (0xC0000005, "", False, "failed", "memory access"),
        (2, "There is no folder", False, "failed", "There is no folder"),
        (1, "", False, "failed", "Show Log"),
    ],
)
def test_endings_are_explained(status: int, said: str, cancelled: bool, phase: str, word: str) -> None:
    ended, error = ending(status, said, cancelled)
    assert ended == phase and word in error and bool(error) == (phase == "failed")


def test_records_survive_and_tell_interruption(tmp_path: Path) -> None:
    assert read_record(tmp_path) is None
    Record("reconstruct", "/photos", 3, {"seed": 1}, pid=os.getpid()).save(tmp_path)
    assert not read_record(tmp_path).interrupted
    began = os.stat(f"/proc/{os.getpid()}").st_mtime
    os.utime(tmp_path / NAME, (began - 3600, began - 3600))  # the number belongs to another process by now
    assert read_record(tmp_path).interrupted
    Record("reconstruct", "/photos", 3, {"seed": 1}, pid=None).save(tmp_path)
    assert read_record(tmp_path).interrupted
    (tmp_path / NAME).write_text("{", "utf-8")
    with pytest.raises(FormatError, match="damaged"):
        read_record(tmp_path)


def test_curves_are_drawn_from_left_to_right() -> None:
    marks = [Mark(step, math.exp(-step / 30), 20 + step / 10) for step in range(0, 101, 10)]
    picture = preview.draw_curves(marks, 100)
    assert picture.shape == (preview.HEIGHT, preview.WIDTH, 4)
    for colour in (preview.LOSS_COLOUR, preview.PSNR_COLOUR):
        rows, columns = np.nonzero(np.all(np.isclose(picture[..., :3], colour), axis=-1))
        assert columns.min() < 12 and columns.max() > preview.WIDTH - 12
        assert rows.max() - rows.min() > 0.8 * preview.HEIGHT
    assert preview.draw_curves([], None).shape == picture.shape


def test_durations_read_well() -> None:
    assert [duration_text(s) for s in (0.2, 59, 65, 4000)] == ["0 s", "59 s", "1 min 05 s", "1 h 06 min"]


def test_the_request_says_all_settings(settings: object, tmp_path: Path) -> None:
    settings.medium, settings.sigma, settings.sigma_minor = "ellipse", 4.0, 2.0
    settings.angle, settings.time_limit, settings.sh_degree = math.radians(30), 1.5, "0"
    settings.max_size, settings.threads, settings.effects = 100, 2, "usual"
    request = request_of("reconstruct", bpy.context.scene)
    text = " ".join(request.arguments)
    assert "--psf gaussian:4,2,30 --blur-space srgb --max-size 100" in text
    assert "--time-limit 90.0s --sh-degree 0 --snapshots --device auto --threads 2" in text
    assert request.out == tmp_path / "photos-twin"
    assert "--preset" not in request_of("cameras", bpy.context.scene).arguments
    settings.medium = "auto"
    for kind in ("reconstruct", "cameras"):
        assert "--psf auto --blur-space srgb" in " ".join(request_of(kind, bpy.context.scene).arguments)
    assert not {"--effects", "--refine-cameras"} & set(request_of("reconstruct", bpy.context.scene).arguments)
    settings.medium, settings.effects, settings.refine_cameras = "auto-each", "auto", True
    text = " ".join(request_of("reconstruct", bpy.context.scene).arguments)
    assert "--psf auto-each" in text and "--effects auto" in text and "--refine-cameras" in text
    settings.medium, settings.effects, settings.refine_cameras = "auto", "none", False
    assert "--effects none" in " ".join(request_of("reconstruct", bpy.context.scene).arguments)
    settings.effects = "usual"


def test_who_sets_nothing_lets_the_photos_decide(settings: object) -> None:
    text = " ".join(request_of("reconstruct", bpy.context.scene).arguments)
    assert "--psf auto --blur-space srgb" in text and "--effects auto" in text


def test_missing_things_are_named(settings: object, tmp_path: Path) -> None:
    scene = bpy.context.scene
    for changes, word in (
        ({"medium": "file"}, "point spread"),
        ({"medium": "none", "cameras": "model"}, "step 2"),
        ({"cameras": "scene"}, "0 of 4 photos"),
        ({"photos": str(tmp_path)}, "No photos here"),
        ({"photos": ""}, "No photos are chosen"),
    ):
        for name, value in changes.items():
            setattr(settings, name, value)
        with pytest.raises(DgsError, match=word):
            request_of("reconstruct", scene)


def test_chosen_photos_and_movies_reach_the_engine(settings: object, tmp_path: Path) -> None:
    settings.selection = "1.png\n3.png\n2.png"
    request = request_of("reconstruct", bpy.context.scene)
    listed = Path(request.arguments[1])
    assert [Path(line).name for line in listed.read_text("utf-8").splitlines()] == ["1.png", "2.png", "3.png"]
    assert request.photos == tmp_path / "photos" and request.count == 3
    assert "--frames" not in request.arguments
    (tmp_path / "walk.mp4").write_bytes(b"movie")
    settings.photos, settings.frames = str(tmp_path / "walk.mp4"), 25
    request = request_of("cameras", bpy.context.scene)
    assert request.arguments[1] == str(tmp_path / "walk.mp4")
    assert request.arguments[request.arguments.index("--frames") + 1] == "25"


def test_the_cameras_of_a_scene_are_given_to_the_engine(settings: object, tmp_path: Path) -> None:
    from dgs.core.formats.transforms import read_transforms

    for number in range(3):
        thing = bpy.data.objects.new(f"{number}", bpy.data.cameras.new("c"))
        thing.location = (number, -4.0, 0.5)
        bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    settings.cameras = "scene"
    arguments = request_of("reconstruct", bpy.context.scene).arguments
    lenses, poses = read_transforms(Path(arguments[arguments.index("--cameras") + 1]))
    assert sorted(poses) == ["0.png", "1.png", "2.png"]
    assert (lenses["1.png"].width, lenses["1.png"].height) == (24, 16)
    np.testing.assert_allclose(poses["2.png"].centre, (2.0, -0.5, -4.0), atol=1e-5)


def test_unusable_photos_are_warned_of(settings: object, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    assert photo_folder(photos).size == (24, 16)
    (photos / "4.jpg").write_bytes(b"no picture")
    forget()
    found = photo_folder(photos)
    assert len(found.files) == 4 and found.warnings == ("4.jpg: no photo inside, it will be left out",)
    for path in found.files[:2]:
        path.write_text("no picture either", "utf-8")
    forget()
    found = photo_folder(photos)
    assert found.problem.startswith("Only 2 photos here") and "0.png: no photo inside" in found.problem
    for path in found.files:
        path.write_bytes(b"")
    forget()
    assert photo_folder(photos).problem.startswith("No photos here") and not photo_folder(photos).files
    assert "cannot be read" in photo_folder(tmp_path / "nowhere").problem
