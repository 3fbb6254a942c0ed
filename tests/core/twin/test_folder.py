"""A twin's folder: one list of what lies in it, states that are kept and come back, and what an update makes stale."""

import shutil

import numpy as np
import pytest
from dgs.core.cloud import GaussianCloud
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.ply import read_ply
from dgs.core.transaction import recover
from dgs.core.twin.folder import PARTS, TwinFolder
from dgs.tests.crashes import crashes


def cloud(value):
    means = np.full((3, 3), value, np.float32)
    quaternions = np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1))
    return GaussianCloud(means, means, quaternions, means[:, 0], np.zeros((3, 1, 3), np.float32))


@pytest.fixture
def folder(memory_path):
    """A twin with every part that belongs to its state."""
    made = TwinFolder(memory_path)
    for part in PARTS:
        if part.folder:
            (memory_path / part.name).mkdir()
            (memory_path / part.name / "one.txt").write_text("before")
        else:
            (memory_path / part.name).write_text("before")
    made.save_twin(cloud(1.0))
    return made


def test_names_are_said_once():
    names = [part.name for part in PARTS]
    assert len(names) == len(set(names))


def test_a_state_comes_back_whole_and_leaves_the_rest(folder):
    assert folder.keep_state().name == "000"
    folder.save_twin(cloud(2.0))
    for part in PARTS:
        if part.state and not part.folder and part.name != "twin.ply":
            (folder.path / part.name).write_text("after")
    (folder.camera_folder / "two.txt").write_text("after")
    folder.report_page.write_text("after")
    assert folder.rollback().name == "000"
    assert read_ply(folder.twin_file).means[0, 0] == 1.0
    for part in PARTS:
        if part.state and not part.folder and part.name != "twin.ply":
            assert (folder.path / part.name).read_text() == "before", part
    assert [path.name for path in folder.camera_folder.iterdir()] == ["one.txt"]
    assert folder.report_page.read_text() == "after", "is no part of the state"
    with pytest.raises(FormatError, match="no earlier state"):
        folder.rollback()


def test_what_a_state_lacked_is_gone_again(folder):
    (folder.path / "update.json").unlink()
    folder.keep_state()
    folder.save_update({"photos": []})
    folder.rollback()
    assert not (folder.path / "update.json").exists()


def test_a_copy_that_was_cut_off_is_no_state(folder):
    (folder.path / "history" / ".000.part").mkdir()
    (folder.path / "history" / "001").mkdir()
    assert folder.states() == []
    assert folder.keep_state().name == "000"


def test_what_speaks_of_the_twin_as_it_was_is_dropped(folder):
    with folder.changing() as change:
        change.remove_stale()
    gone = {part.name for part in PARTS if not (folder.path / part.name).exists()}
    assert gone == {"known.npy", "next_views.json", "next_views"}


def test_damaged_files_are_explained_or_as_good_as_none(folder):
    with pytest.raises(FormatError, match="damaged"):
        folder.report()
    with pytest.raises(FormatError, match="damaged"):
        folder.update_log()
    assert folder.plan() == {}
    folder.save_plan({"gaussians": 5, "grid_step": None})
    folder.save_report({"settings": {"run": {"psf": "none", "photos": "photos", "out": "twin"}}})
    assert folder.plan() == {"gaussians": 5, "grid_step": None} and folder.report()["settings"]["run"]["psf"] == "none"
    (folder.path / "twin.json").unlink()
    assert folder.update_log() == {}
    folder.twin_file.unlink()
    with pytest.raises(FormatError, match="no twin folder"):
        folder.report()


def test_snapshots_and_renders_stand_where_the_panel_looks(folder):
    folder.save_snapshot(b"png", b"npy", cloud(3.0))
    folder.save_render("a.png", b"render")
    assert sorted(path.name for path in (folder.path / "snapshot").iterdir()) == [
        "one.txt",
        "picture.png",
        "preview.npy",
        "twin.ply",
    ]
    assert (folder.path / "renders" / "a.png").read_bytes() == b"render"
    folder.save_photo_list([folder.path / "b.png", folder.path / "a.png"])
    assert folder.photo_list.read_text("utf-8").splitlines() == [str(folder.path / n) for n in ("b.png", "a.png")]


def content(path):
    """Every file's bytes, by name."""
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def restore(path, kept):
    """The folder as `kept` holds it."""
    shutil.rmtree(path, ignore_errors=True)
    for name, data in kept.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)


def update(folder):
    """What an update writes, without its training."""
    with folder.changing() as change:
        change.keep_state()
        change.new.save_twin(cloud(2.0))
        change.new.save_update({"photos": ["new.png"]})
        change.new.save_photo_list([folder.path / "a.png", folder.path / "new.png"])
        change.new.camera_folder.mkdir()
        (change.new.camera_folder / "two.txt").write_text("after")
        change.remove_stale()


@pytest.mark.parametrize("fault", ["kill", "full"])
def test_an_update_cut_off_anywhere_is_as_before_or_as_after(folder, fault):
    before = content(folder.path)
    update(folder)
    after = content(folder.path)
    assert after.keys() - before.keys() >= {"history/000/twin.ply", "history/000/cameras/one.txt", "cameras/two.txt"}
    assert {"cameras/one.txt", "known.npy", "next_views/one.txt"} <= before.keys() - after.keys()
    restore(folder.path, before)
    for _ in crashes(lambda: update(folder), folder.path, fault, OutputError):
        recover(folder.path)
        assert content(folder.path) in (before, after)
        restore(folder.path, before)


@pytest.mark.parametrize("fault", ["kill", "full"])
def test_a_rollback_cut_off_anywhere_and_asked_for_again_brings_back_one_state(folder, fault):
    first = content(folder.path)
    update(folder)
    second = content(folder.path)
    folder.save_twin(cloud(3.0))
    folder.keep_state()
    folder.save_twin(cloud(4.0))
    newest = content(folder.path)
    folder.rollback()
    older = content(folder.path)
    assert older["twin.ply"] != second["twin.ply"] and "history/001/twin.ply" not in older
    restore(folder.path, newest)
    for _ in crashes(lambda: folder.rollback(), folder.path, fault, OutputError):
        recover(folder.path)
        assert content(folder.path) in (newest, older)
        if content(folder.path) == newest:
            folder.rollback()
        assert content(folder.path) == older
        folder.rollback()
        assert {name: data for name, data in content(folder.path).items() if name in first} == first
        restore(folder.path, newest)
