"""What the add-on reads from the disk, damaged at random: a result or an explained error, never a Python traceback."""

from __future__ import annotations

import json
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from bl_ui.utils import PresetPanel  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.errors import DgsError  # noqa: E402
from dgs.core.formats.ply import write_ply  # noqa: E402
from dgs.dgs_addon.engine.question import Question  # noqa: E402
from dgs.dgs_addon.job import runner, steps  # noqa: E402
from dgs.dgs_addon.job.preview import draw_curves  # noqa: E402
from dgs.dgs_addon.job.record import Record  # noqa: E402
from dgs.dgs_addon.job.snapshot import SnapshotReader  # noqa: E402
from dgs.dgs_addon.job.state import JobState  # noqa: E402
from dgs.dgs_addon.job.watching import twins_photos  # noqa: E402
from dgs.dgs_addon.job.worker import Ended, Worker  # noqa: E402
from dgs.dgs_addon.questions import estimate, inspection  # noqa: E402
from dgs.panels import CLASSES  # noqa: E402
from dgs.panels import job as job_panel  # noqa: E402
from dgs.studies.stability.damage import damaged, damaged_npy  # noqa: E402

#: Damaged versions of each file.
FILES = 40
#: A redraw that takes longer is felt as a frozen window (s of processor time).
FROZEN = 2.0
#: Without a window Blender has no scale of its own.
PREFERENCES = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))


class Layout:
    """Stands for Blender's layout, which there is none of without a window; takes what is drawn."""

    def __getattr__(self, name: str) -> Any:
        if name == "panel":
            return lambda *_a, **_k: (Layout(), Layout())
        return self._draw

    def __setattr__(self, name: str, value: object) -> None:
        return None

    def _draw(self, *_arguments: object, **values: object) -> Layout:
        assert isinstance(values.get("text", ""), str)
        factor = values.get("factor", 0.0)
        assert isinstance(factor, float | int) and 0.0 <= factor <= 1.0
        return Layout()


@pytest.fixture
def out(tmp_path: Path, cloud: GaussianCloud) -> Iterator[Path]:
    """A results' folder with a file of every kind, as the engine and the add-on leave them."""
    dgs.register()
    folder = tmp_path / "photos-twin"
    (folder / "snapshot").mkdir(parents=True)
    (tmp_path / "photos").mkdir()
    bpy.context.scene.dgs.photos = str(tmp_path / "photos")
    write_ply(folder / "twin.ply", cloud)
    (folder / "cameras").mkdir()
    (folder / "cameras" / "cameras.txt").write_text("1 PINHOLE 80 60 90 90 40 30\n")
    poses = "".join(f"{i} 1 0 0 0 {i} 0 {i} 1 a{i}.png\n\n" for i in (1, 2, 3))
    (folder / "cameras" / "images.txt").write_text(poses)
    (folder / "cameras" / "points3D.txt").write_text("1 0 0 5 255 0 0 0\n2 1 0 5 0 255 0 0\n")
    Record("reconstruct", str(tmp_path / "photos"), 3, {"psf": "none", "threads": 1}, phase="failed").save(folder)
    score = {"psnr": 21.5, "ssim": 0.9}
    band = {"finest": 7.0, "coarsest": 10.0, "gain": 1.0, "correlation": 0.8, "energy": 1.0}
    held = {"names": ["a1.png"], "degraded": score, "sharp": {"psnr": None}, "bands": [band]}
    report = {
        "photos": {"folder": str(tmp_path / "photos"), "registered": 3, "given": 3},
        "settings": {"run": {"psf": "none", "photos": str(tmp_path / "photos"), "out": str(folder)}},
        "medium": {"psf": "none"},
        "heldout": held,
        "gaussians": 9,
        "resolvable_period_px": 2.0,
    }
    (folder / "report.json").write_text(json.dumps(report))
    view = {"order": 1, "name": "v", "width": 80, "height": 60, "fx": 90.0, "fy": 90.0, "cx": 40.0, "cy": 30.0}
    view |= {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 1.0], "bits": 12.5}
    (folder / "next_views.json").write_text(json.dumps({"views": [view, {**view, "order": None}]}))
    np.save(folder / "known.npy", np.linspace(0, 1, 9, dtype=np.float32))
    np.save(folder / "snapshot" / "preview.npy", np.full((12, 16, 3), 99, np.uint8))
    (folder / "update.json").write_text(json.dumps({"photos": ["a.png", "b.png"]}))
    (folder / "twin.json").write_text(json.dumps({"held": ["a1.png"], "psf": {"b.png": "none"}, "updates": [{}]}))
    (folder / "photos.txt").write_text("/x/a1.png\n/x/a2.png\n")
    (folder / "job.log").write_text('$ python run_dgs.py\n{"event": "note", "text": "words"}\n')
    shutil.copytree(folder, tmp_path / "state")
    shutil.copytree(tmp_path / "state", folder / "history" / "000")
    yield folder
    dgs.unregister()


def pressed(button: str) -> bool:
    """Whether a button worked; where it did not, it has said so in words."""
    try:
        return getattr(bpy.ops.dgs, button)() == {"FINISHED"}
    except RuntimeError as error:
        assert "Traceback" not in str(error), error
        return False


def draw() -> None:
    """All panels, as a redraw of the sidebar does."""
    context = SimpleNamespace(
        scene=bpy.context.scene,
        object=bpy.context.object,
        mode="OBJECT",
        view_layer=bpy.context.view_layer,
        region=SimpleNamespace(width=320),
        preferences=PREFERENCES,
        space_data=None,
        engine=bpy.context.scene.render.engine,
    )
    for kind in CLASSES:
        if issubclass(kind, PresetPanel):  # Blender's own draws it
            continue
        panel = SimpleNamespace(layout=Layout())
        for method in ("_state", "_kind", "_draw_found"):
            if hasattr(kind, method):
                setattr(panel, method, getattr(kind, method).__get__(panel))
        if not hasattr(kind, "poll") or kind.poll(context):
            kind.draw(panel, context)
        if hasattr(kind, "draw_header_preset"):
            kind.draw_header_preset(panel, context)


def show_known() -> None:
    twin = bpy.context.object
    if "known" in twin.data.attributes and "dgs_own_base" in twin.data.attributes:
        pressed("show_known")
    pressed("show_known")


def read_preview(out: Path) -> None:
    reader = SnapshotReader(out, live=True, most=5)
    reader._seen = dict.fromkeys(reader._seen)
    reader.read_news()


def read_states(_out: Path) -> None:
    pressed("show_states")
    bpy.ops.dgs.rollback_twin.poll()


#: File in the folder -> what Blender does with it.
READ: dict[str, Callable[[Path], object]] = {
    "job.json": lambda out: (runner.unfinished(out), bpy.ops.dgs.resume_job.poll(), bpy.ops.dgs.compare_truth.poll()),
    "report.json": lambda out: (steps.results(bpy.context.scene), pressed("add_results"), twins_photos(out, None)),
    "twin.ply": lambda _out: pressed("add_results"),
    "cameras/images.txt": lambda _out: pressed("show_cameras"),
    "cameras/cameras.txt": lambda _out: pressed("show_cameras"),
    "cameras/points3D.txt": lambda _out: pressed("show_cameras"),
    "next_views.json": lambda _out: pressed("show_next_views"),
    "known.npy": lambda _out: show_known(),
    "snapshot/preview.npy": read_preview,
    "update.json": read_states,
    "history/000/update.json": read_states,
    "history/000/twin.ply": read_states,
    "twin.json": read_states,
    "photos.txt": lambda out: twins_photos(out, None),
    "job.log": lambda _out: pressed("show_log"),
}


@pytest.mark.parametrize("name", READ)
def test_a_damaged_file_of_the_folder_is_no_traceback(out: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """The valid file is read first, so that the way there is proved; nothing is written to the console meanwhile."""
    assert pressed("add_results")
    content = (out / name).read_bytes()
    READ[name](out)
    draw()
    random = np.random.default_rng(sum(name.encode()))
    for number in range(FILES):
        bad = (damaged_npy if name.endswith(".npy") else damaged)(content, random)
        (out / name).write_bytes(bad)
        began = time.process_time()
        try:
            READ[name](out)
            draw()
        except Exception as error:  # noqa: BLE001 (whatever it is, it would be a traceback in the console)
            kept = bad if len(bad) < 2000 else b"..."
            pytest.fail(f"{name}, damage {number}: {type(error).__name__}: {error}\n{kept!r}")
        assert time.process_time() - began < FROZEN
        (out / name).write_bytes(content)
        if name in ("twin.ply", "known.npy"):  # the twin in the scene is another by now
            pressed("add_results")
    console = capfd.readouterr()
    assert "Traceback" not in console.out + console.err


EVENTS = (
    {"event": "stage", "name": "train", "total": 300},
    {"event": "advance", "stage": "train", "done": 20, "total": 300, "seconds_left": 3.5, "loss": 0.1},
    {"event": "advance", "stage": "train", "done": 40, "total": 300, "loss": 0.1, "heldout_psnr": 21.0},
    {"event": "note", "text": "words"},
    {"event": "done", "result": {"report": "/x", "registered": "3 of 3"}},
    {"event": "error", "text": "What happened. The way out.", "status": 2},
)


def test_damaged_progress_neither_ends_the_worker_nor_the_panel(tmp_path: Path) -> None:
    random, lines = np.random.default_rng(3), []
    for number in range(400):
        line = damaged(json.dumps(EVENTS[number % len(EVENTS)]).encode(), random)
        lines.append(re.sub(rb"[\r\n]", b" ", line))
    lines += [b'{"event": ' + b"[" * 100_000, b'{"event": "note", "text": "' + b"x" * 3_000_000 + b'"}']
    lines.append(json.dumps({"event": "note", "text": "the last one"}).encode())
    (tmp_path / "lines").write_bytes(b"\n".join(lines) + b"\n")
    worker = Worker(["cat", str(tmp_path / "lines")], tmp_path / "job.log")
    worker.start()
    assert worker.join(20)
    state, ended = JobState(), None
    context = SimpleNamespace(region=SimpleNamespace(width=320), preferences=PREFERENCES)
    while ended is None:
        message = worker.events.get_nowait()
        if isinstance(message, Ended):
            ended = message
            break
        state.apply(message)
        job_panel._running(Layout(), context, SimpleNamespace(state=state, request=None))
        draw_curves(state.marks, state.total)
    assert ended.status == 0 and state.notes[-1] == "the last one"
    assert len(state.marks) > 9, "some lines are whole enough to be taken in"


ANSWERS: dict[str, tuple[Question, dict[str, Any], Callable[[dict[str, Any]], object]]] = {
    "inspection": (
        inspection.effects,
        {"effects": [{"name": "haze", "needed": True, "evidence": "seen", "estimate": {"value": 0.2}}] * 2},
        inspection.sentences,
    ),
    "point spread": (inspection.point_spread, {"sigma": 2.0, "sigma_uncertainty": 0.1}, lambda _answer: draw()),
    "estimate": (
        estimate.question,
        {
            "trials": True,
            "presets": dict.fromkeys(
                ("draft", "balanced", "fine", "best"),
                {
                    "seconds": {"value": 9.0, "low": 5.0, "high": 20.0, "calibrated": False},
                    "memory_mb": {"value": 900.0},
                    "psnr": {"value": 25.0, "low": 24.0, "high": 26.0},
                },
            ),
        },
        lambda answer: estimate.sentences(answer, "draft"),
    ),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_damaged_answer_of_the_engine_is_no_traceback(out: Path, name: str) -> None:
    question, answer, show = ANSWERS[name]
    content, random = json.dumps(answer).encode(), np.random.default_rng(5)
    answered = 0
    for number in range(FILES):
        (out / "answer").write_bytes(damaged(content, random) if number else content)
        question.ask((bpy.context.scene.dgs.photos,), "Asking", ["cat", str(out / "answer")])
        assert question.errand is not None and question.errand.join(10) and question.take()
        answered += bool(question.answer)
        if question.answer:
            show(question.answer)
        draw()
        assert number or question.answer == answer
    assert 1 < answered < FILES
    question.answer, question.error = {}, ""


BUTTONS = ("optimize", "find_cameras", "resume_job", "add_results", "show_log", "update_twin", "make_test_set")
HOSTILE = ("x" * 300, "/" + "y/" * 3000, "//" * 50 + "z" * 5000, "\t\n", "/proc/self/mem", "/dev/zero", "~nobody/../..")


@pytest.mark.parametrize("text", HOSTILE)
def test_paths_that_are_none_are_no_traceback(out: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings come with a .blend from anybody, the engine's Python from the preferences and the environment."""
    settings = bpy.context.scene.dgs
    names = ("photos", "out", "masks", "model", "psf_file", "truth", "test_set", "new_photos")
    kept = {name: getattr(settings, name) for name in names}
    settings.cameras, settings.medium = "model", "file"
    for name in (*names, "DGS_ENGINE_PYTHON"):
        if name.isupper():
            monkeypatch.setenv(name, text)
        else:
            setattr(settings, name, text)
        draw()
        for button in BUTTONS:
            pressed(button)
        if name in kept:
            setattr(settings, name, kept[name])


def test_links_that_lead_to_themselves_are_no_traceback(out: Path) -> None:
    loop = out / "loop"
    loop.symlink_to(loop)
    for name in ("photos", "out", "model", "psf_file"):
        setattr(bpy.context.scene.dgs, name, str(loop / "x"))
        draw()
        pressed("optimize")


def test_the_engines_mark_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dgs.dgs_addon.engine import folder, interpreter

    engine = tmp_path / "engine"
    (engine / "bin" / "python").mkdir(parents=True)  # no program
    folder.stamp(engine, folder.REQUIREMENTS).mkdir()
    monkeypatch.setattr(folder, "engine_folder", lambda: engine)
    assert not folder.is_installed()
    folder.stamp(engine, folder.REQUIREMENTS).rmdir()
    folder.stamp(engine, folder.REQUIREMENTS).write_bytes(b"\0" * 99)
    assert not folder.is_installed()
    monkeypatch.setenv("DGS_ENGINE_PYTHON", str(engine / "bin" / "python"))
    with pytest.raises(DgsError, match="is not there"):
        interpreter.find_python()
    monkeypatch.setenv("DGS_ENGINE_PYTHON", sys.executable)
    assert interpreter.find_python() == Path(sys.executable)
