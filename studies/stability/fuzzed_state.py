"""What the program itself keeps in folders, for `reader_fuzz`: a twin's files, its journal and lock, past runs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filelock import FileLock
from PIL import Image

from ...core.effort.model import accuracy, memory, stage_seconds
from ...core.effort.records import PastRun, Records, Work
from ...core.errors import FolderInUse
from ...core.formats.colmap import write_model
from ...core.imaging.choices import read_choices
from ...core.lock import LOCK, OWNER, locked
from ...core.outputs import LIST as WRITTEN
from ...core.outputs import check_outputs, note_output
from ...core.progress import Silent
from ...core.report.known import END, START, drop_chapter
from ...core.sfm.features import Features, load_features, save_features
from ...core.sfm.settings import recipes
from ...core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ...core.transaction import COMMIT, CONTENT, FORMAT, recover
from ...core.transaction import LIST as JOURNAL
from ...core.twin.folder import TwinFolder
from ...core.twin.opened import open_files
from .damage import damaged, inside_npz
from .fuzzed_samples import cameras, cloud, points
from .reader_fuzz import Reader

_WORK = Work(2, 0.1, 0.1, 2, 0, 300, 1000, True, False, True, True)


def _checkpoint() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        c = cloud()
        values = {"means": c.means, "log_scales": c.log_scales, "quaternions": c.quaternions}
        values |= {"opacity_logits": c.opacity_logits, "sh": c.sh}
        arrays = {f"{kind}.{name}": value for kind in ("value", "first") for name, value in values.items()}
        arrays |= {f"second.{name}": np.square(value) for name, value in values.items()}
        arrays |= {name: np.ones(len(c.means), np.float32) for name in ("pull", "views")}
        state = Checkpoint(arrays, {"photos": ["a.png"]}, 7, 1.5, [{"step": 7.0, "loss": 0.1}], {"steps": 7})
        save_checkpoint(place / "checkpoint.npz", state)

    return Reader(
        "checkpoint", write, lambda p: load_checkpoint(p / "checkpoint.npz", {}), "checkpoint.npz", inside_npz
    )


def _features() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        one = Features(np.ones((5, 2), np.float32), np.ones((5, 128), np.uint8), "a digest")
        save_features(place / "features.npz", {"a.png": one, "b.png": one}, recipes(False)[0])

    def read(place: Path) -> object:
        return load_features(place / "features.npz") or "found again"

    return Reader("features", write, read, "features.npz", inside_npz, forgives=True)


def write_twin(place: Path) -> None:
    """A whole twin's folder of two small photos, `place`/twin."""
    folder = TwinFolder(place / "twin")
    photos = [place / "photos" / name for name in ("a.png", "b.png")]
    photos[0].parent.mkdir(parents=True, exist_ok=True)
    for index, photo in enumerate(photos):
        pixels = np.random.default_rng(index).integers(0, 255, (30, 40, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(photo)
    folder.save_twin(cloud())
    folder.save_photo_list(photos)
    write_model(folder.camera_folder, cameras(), points())
    run = {
        "photos": "photos",
        "out": "twin",
        "psf": "gaussian:2",
        "blur_space": "srgb",
        "holdout_every": 8,
        "frames": 9,
    }
    run |= {"max_size": 64, "seed": 0, "preset": "draft", "effects": "none", "cameras": None, "masks": None}
    medium = {"per_photo": {"b.png": "gaussian:1"}}
    folder.save_report({"settings": {"run": run, "training": {"sh_degree": 1}}, "steps": 300, "medium": medium})
    folder.save_update_log(
        {"held": ["a.png"], "psf": {"b.png": "gaussian:2"}, "updates": [{"photos": ["c.png"], "steps": 20}]}
    )


def _twin(name: str, file: str) -> Reader:
    return Reader(name, write_twin, lambda p: open_files(p / "twin", Silent()), f"twin/{file}", damaged)


def _plan() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        plan = {"limit": 60.0, "hurried": False, "steps": 300, "gaussians": 2000, "grid_step": None, "scored": 2}
        TwinFolder(place).save_plan(plan)

    def read(place: Path) -> object:
        plan = TwinFolder(place).plan()
        assert not plan or (plan["gaussians"] > 0 and (plan["grid_step"] is None or plan["grid_step"] > 0))
        return plan

    return Reader("plan.json", write, read, "plan.json", damaged, forgives=True)


def _trials() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        said = {"differences": [0.25, -1.0], "seen": "", "least": None}
        TwinFolder(place).save_trials({"0123456789abcdef" * 2: said})

    def read(place: Path) -> object:
        trials = TwinFolder(place).trials()
        for said in trials.values():
            assert np.isfinite(np.array(said["differences"], np.float64)).all()
        return trials

    return Reader("trials.json", write, read, "trials.json", damaged, forgives=True)


def _history() -> Reader:
    """What a rollback brings back, opened."""

    def write(place: Path) -> None:
        write_twin(place)
        TwinFolder(place / "twin").keep_state()

    def read(place: Path) -> object:
        # Rolled back in a copy: the state is taken out of the history.
        shutil.rmtree(place / "rolled", ignore_errors=True)
        shutil.copytree(place / "twin", place / "rolled")
        TwinFolder(place / "rolled").rollback()
        return open_files(place / "rolled", Silent())

    return Reader("history", write, read, "twin/history/000/report.json", damaged)


def _journal() -> Reader:
    """The list of an unfinished change of a folder."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        lists = {"format": FORMAT, "place": ["a.txt", "sub/b.txt"], "remove": ["c.txt"]}
        (place / JOURNAL).write_text(json.dumps(lists), "utf-8")

    def read(place: Path) -> object:
        folder = place / "outer" / "folder"
        shutil.rmtree(place / "outer", ignore_errors=True)
        content = folder / COMMIT / CONTENT
        (content / "sub").mkdir(parents=True)
        for file in (content / "a.txt", content / "sub" / "b.txt", folder / "c.txt", place / "outer" / "stays.txt"):
            file.write_text("x", "utf-8")
        shutil.copy(place / JOURNAL, folder / COMMIT / JOURNAL)
        said = recover(folder)
        assert sorted(f.name for f in (place / "outer").iterdir()) == ["folder", "stays.txt"], "it left its folder"
        return said

    return Reader("journal", write, read, JOURNAL, damaged)


def _owner() -> Reader:
    """Who holds a folder's lock."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        (place / OWNER).write_text(json.dumps({"process": 7, "task": "update", "since": "2026-01-01"}), "utf-8")

    def read(place: Path) -> object:
        with FileLock(place / LOCK, timeout=0):
            try:
                with locked(place, "fuzz"):
                    raise AssertionError("the lock was free")
            except FolderInUse:
                pass
        return "refused"

    return Reader("lock owner", write, read, OWNER, damaged, forgives=True)


def _records() -> Reader:
    """This machine's past runs, and what is predicted from them."""

    def records(place: Path) -> Records:
        return Records({"processor": "x", "cores": 2, "threads": 2, "device": "cpu"}, place)

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        for index in range(4):
            seconds = {"start": 1.0, "photos": 0.5, "sfm": 9.0, "train": 30.0, "save": 2.0}
            run = PastRun(_WORK, seconds, 28.0, 900.0, f"scene{index}", "draft", 0.1, 25.0, None, 0.0)
            records(place).add(run)
        records(place).predict("key", {"seconds": {"value": 30.0}})
        (file,) = place.glob("runs-*.json")
        file.rename(place / "runs.json")

    def read(place: Path) -> object:
        shutil.copy(place / "runs.json", records_file(place))
        kept = records(place)
        stage_seconds(kept.runs, _WORK, 30.0)
        memory(kept.runs, _WORK)
        accuracy(kept.runs, "draft", "scene9", 0.1)
        kept.add(PastRun(_WORK, {"start": 1.0}, None, None, "s", "draft", 0.1, None, None, None))
        return kept

    def records_file(place: Path) -> Path:
        return records(place).path

    return Reader("runs of a machine", write, read, "runs.json", damaged, forgives=True)


def _choices() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        (place / "evaluations.json").write_text(json.dumps({"a | b": "fft", "c": "direct"}), "utf-8")

    return Reader(
        "choices of blur", write, lambda p: read_choices(p / "evaluations.json"), "evaluations.json", damaged, True
    )


def _written() -> Reader:
    """The list of what this program wrote into a folder."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        for name in ("a.txt", "b.txt"):
            (place / name).write_text(name, "utf-8")
            note_output(place / name)

    def read(place: Path) -> str:
        check_outputs([place / "a.txt"])
        return "ours"

    return Reader("list of outputs", write, read, WRITTEN, damaged)


def _page() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        (place / "report.html").write_text(f"<html>{START}<p>known</p>{END}<p>rest</p></html>", "utf-8")

    def read(place: Path) -> str:
        drop_chapter(place / "report.html")
        return "there"

    return Reader("report.html", write, read, "report.html", damaged, True)


def state_readers() -> list[Reader]:
    """All of them."""
    make: tuple[Callable[[], Reader], ...] = (
        *(_checkpoint, _features, _trials, _plan, _history, _journal, _owner, _records, _choices, _written, _page),
    )
    return [
        *(one() for one in make),
        _twin("report.json", "report.json"),
        _twin("twin.json", "twin.json"),
        _twin("photos.txt", "photos.txt"),
        _twin("twin.ply", "twin.ply"),
        _twin("twin's cameras", "cameras/images.bin"),
    ]
