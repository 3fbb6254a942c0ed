"""Photos, settings and masks on their way to the child, and what it says on its way back."""

from __future__ import annotations

import io
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core import errors
from dgs.core.errors import CameraError, Cancelled, NativeCrash
from dgs.core.photos.load import Photo
from dgs.core.progress import Silent
from dgs.core.reconstruction import Attempt
from dgs.core.sfm import child as child_module
from dgs.core.sfm import find
from dgs.core.sfm.child import wait_for
from dgs.core.sfm.features import Features, load_features, save_features
from dgs.core.sfm.job import read_job, write_job
from dgs.core.sfm.settings import Recipe, SfmSettings
from dgs.core.sfm.triangulate import Triangulated
from PIL import Image


def photo(name: str, width: int = 6, focal: float | None = None, masked: bool = False) -> Photo:
    pixels = np.full((4, width, 3), 51, np.uint8)
    mask = None
    if masked:
        mask = np.ones((4, width), bool)
        mask[1, 2] = False
    return Photo(name, Path(name), pixels, mask, focal_px=focal)


def test_photos_of_one_lens_lie_in_one_folder(tmp_path: Path) -> None:
    photos = [photo("é.png"), photo("b", 8), photo("c", focal=70.2), photo("d", focal=69.8, masked=True), photo("e")]
    kernel = np.arange(9.0).reshape(3, 3)
    names = write_job(photos, kernel, SfmSettings(threads=3), tmp_path / "work")
    assert names == {"0/0000.png": "é.png", "1/0001.png": "b", "2/0002.png": "c", "2/0003.png": "d", "0/0004.png": "e"}
    job = read_job(tmp_path / "work")
    assert job.focals == {"2": 69.8} and job.masked and job.settings == SfmSettings(threads=3)
    assert list(job.images) == list(names) and job.kernel is not None and np.array_equal(job.kernel, kernel)
    grey = np.load(job.images["1/0001.png"])
    assert grey.dtype == np.uint16 and grey.shape == (4, 8) and (grey == 13107).all()  # 51 / 255 of 65535
    masks = {name: np.array(Image.open(tmp_path / "work" / "masks" / f"{name}.png")) for name in names}
    assert masks["2/0003.png"][1, 2] == 0 and (np.delete(masks["2/0003.png"].ravel(), 8) == 255).all()
    assert all((masks[name] == 255).all() for name in names if name != "2/0003.png")
    assert masks["1/0001.png"].shape == (4, 8)


def test_sharp_photos_without_masks(tmp_path: Path) -> None:
    write_job([photo("a")], None, SfmSettings(), tmp_path)
    job = read_job(tmp_path)
    assert job.kernel is None and not job.masked and job.focals == {} and not (tmp_path / "kernel.npy").exists()


def test_a_child_waits_for_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "go").touch()
    wait_for(tmp_path / "go")
    monkeypatch.setattr(child_module, "PATIENCE", 0.05)
    began = time.perf_counter()
    with pytest.raises(TimeoutError, match="other"):
        wait_for(tmp_path / "other")
    assert 0.05 <= time.perf_counter() - began < 5.0


# --- what the child says ------------------------------------------------------------------------------------------


class Heard(Silent):
    def __init__(self) -> None:
        self.notes: list[str] = []
        self.done: list[int] = []

    def note(self, text: str) -> None:
        self.notes.append(text)

    def advance(self, done: int, **figures: float) -> None:
        self.done.append(done)


def lines(*texts: str, limit: float = 5.0) -> list[Any]:
    return list(find._messages(io.BytesIO("\n".join([*texts, ""]).encode()), Silent(), limit))


def test_only_lines_of_json_are_messages() -> None:
    assert lines('{"a": 1}', "native words", "{no json}", "[1]", '{"b": 2}') == [{"a": 1}, {"b": 2}]


class Endless(io.RawIOBase):
    def __iter__(self) -> Any:
        time.sleep(3.0)
        return iter(())


def test_a_child_that_says_nothing_is_waited_for_so_long_only() -> None:
    class Stopped(Silent):
        def cancelled(self) -> bool:
            return True

    began = time.perf_counter()
    with pytest.raises(CameraError, match=r"within 0\.2 s"):
        list(find._messages(Endless(), Silent(), 0.2))
    with pytest.raises(Cancelled):
        list(find._messages(Endless(), Stopped(), 60.0))
    assert 0.2 <= time.perf_counter() - began < 2.0


def script(folder: Path, *messages: object, status: int = 0, native: str = "") -> Path:
    """A worker that says these things and ends."""
    words = "".join(json.dumps(m) + "\n" for m in messages)
    path = folder / "worker.py"
    path.write_text(
        f"import sys\nsys.stdout.write({words!r})\nsys.stderr.write({native!r})\nsys.exit({status})\n", "utf-8"
    )
    return path


ATTEMPT = {"name": "n", "reason": "r", "registered": 3}


def test_what_a_child_says_is_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trusted, poor = ({**ATTEMPT, "verdict": v} for v in ("trusted", "too few points"))
    messages = [{"joined": 2}, {"joined": 9}, {"attempt": poor}, {"attempt": trusted}, {"done": {"x": 1}}, {"stage": 1}]
    monkeypatch.setattr(find, "_WORKER", script(tmp_path, *messages))
    heard = Heard()
    attempts, done = find.talk(tmp_path, 5, SfmSettings(), heard)
    assert done == {"x": 1} and attempts == [Attempt(**poor), Attempt(**trusted)]
    assert heard.done == [2, 5]  # never more than there are
    assert heard.notes == ["Cameras, attempt 'n': too few points (3 of 5)"]


def test_a_failure_is_the_error_that_it_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failed = {"kind": "NoOverlap", "what": "what", "way_out": "way out"}
    monkeypatch.setattr(find, "_WORKER", script(tmp_path, {"failed": failed}))
    with pytest.raises(errors.NoOverlap, match="what") as error:
        find.talk(tmp_path, 5, SfmSettings(), Silent())
    assert error.value.way_out == "way out"


@pytest.mark.parametrize(("messages", "status"), [([], 0), ([{"done": {}}], 7)])
def test_a_child_that_ends_early_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: list[object], status: int
) -> None:
    monkeypatch.setattr(find, "_WORKER", script(tmp_path, *messages, status=status, native="first\nlast words\n"))
    with pytest.raises(NativeCrash, match=rf"\(exit status {status}; it last said: last words\)"):
        find.talk(tmp_path, 5, SfmSettings(), Silent())


@pytest.mark.parametrize(("status", "said"), [(-11, "signal SIGSEGV"), (-99, "signal 99"), (1, "exit status 1")])
def test_how_a_child_ended(tmp_path: Path, status: int, said: str) -> None:
    assert f"({said})" in str(find._crash(status, tmp_path / "none.log"))
    (tmp_path / "long.log").write_text("~" * 500)
    assert str(find._crash(status, tmp_path / "long.log")).count("~") == 200


# --- features that stay -------------------------------------------------------------------------------------------


def one(value: int, count: int = 2) -> Features:
    return Features(np.full((count, 2), value, np.float32), np.full((count, 128), value, np.uint8))


def test_features_are_kept_by_the_photos_names_and_digests(tmp_path: Path) -> None:
    recipe, keep = Recipe("a", "b"), tmp_path / "features.npz"
    find.keep_features(tmp_path / "none.npz", keep, {})
    assert not keep.exists()
    photos = {f"0/000{i}.png": replace(photo(name), content=name * 3) for i, name in enumerate("xy")}
    save_features(tmp_path / "1.npz", {"0/0000.png": one(1), "0/0001.png": one(2)}, recipe)
    earlier = {"y": one(5), "z": one(6)}
    for kept, names in (((earlier, recipe), "xyz"), ((earlier, replace(recipe, seed=1)), "xy"), (None, "xy")):
        find.keep_features(tmp_path / "1.npz", keep, photos, kept)  # (features of two kinds do not match)
        found = load_features(keep)
        assert found is not None and found[1] == recipe
        values = {name: (int(f.positions[0, 0]), f.content) for name, f in found[0].items()}
        assert values == {n: {"x": (1, "xxx"), "y": (2, "yyy"), "z": (6, "")}[n] for n in names}


@pytest.mark.parametrize(
    ("matches", "share", "contradicts"), [(200, 0.34, True), (200, 0.35, False), (199, 0.0, False), (900, 0.1, True)]
)
def test_when_photos_contradict_their_cameras(matches: int, share: float, contradicts: bool) -> None:
    empty = np.zeros((0, 3))
    found = Triangulated(empty, empty.astype(np.uint8), np.zeros((0, 2), np.int64), (), matches, share)
    assert found.contradicts is contradicts
