"""A change of a folder happens whole or not at all, wherever it is cut off."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from dgs.core.errors import OutputError
from dgs.core.transaction import COMMIT, CONTENT, changing, recover
from dgs.tests.crashes import crashes


def state(folder: Path) -> dict[str, str]:
    """Every file's content by name, hidden ones left out only if they are empty folders."""
    return {p.relative_to(folder).as_posix(): p.read_text("utf-8") for p in folder.rglob("*") if p.is_file()}


def begin(folder: Path) -> dict[str, str]:
    """The folder as it is before."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "cameras").mkdir(parents=True)
    for name in ("twin.ply", "report.json", "cameras/a.txt", "cameras/b.txt", "update.json"):
        (folder / name).write_text(f"old {name}", "utf-8")
    return state(folder)


def change(folder: Path) -> None:
    """Two files replaced, a folder replaced, a file and a state added, one removed."""
    with changing(folder) as new:
        for name in ("twin.ply", "report.json", "history/000/twin.ply"):
            new.new(name).write_text(f"new {name}", "utf-8")
        cameras = new.new("cameras")
        cameras.mkdir()
        (cameras / "a.txt").write_text("new a", "utf-8")
        new.remove("update.json")
        new.remove("was never there")


AFTER = {
    "twin.ply": "new twin.ply",
    "report.json": "new report.json",
    "history/000/twin.ply": "new history/000/twin.ply",
    "cameras/a.txt": "new a",
}


def test_a_change_happens_whole(memory_path):
    begin(memory_path / "t")
    change(memory_path / "t")
    assert state(memory_path / "t") == AFTER
    assert recover(memory_path / "t") is None


def test_an_error_inside_leaves_everything_as_it_was(memory_path):
    before = begin(memory_path / "t")
    with pytest.raises(ZeroDivisionError), changing(memory_path / "t") as new:
        new.new("twin.ply").write_text("half")
        raise ZeroDivisionError
    assert state(memory_path / "t") == before


def test_an_announced_file_that_was_not_written_is_refused(memory_path):
    before = begin(memory_path / "t")
    with pytest.raises(OutputError, match="not written"), changing(memory_path / "t") as new:
        new.new("twin.ply")
    assert state(memory_path / "t") == before


@pytest.mark.parametrize("name", ["../a", "/a", "a/../../b", "", "c:\\a", "a\\b"])
def test_names_stay_inside(memory_path, name):
    with pytest.raises(ValueError, match="inside"), changing(memory_path) as new:
        new.new(name)


def test_killed_at_every_file_operation_it_is_as_before_or_as_after(memory_path):
    folder, outcomes = memory_path / "t", []
    before = begin(folder)
    for _ in crashes(lambda: change(folder), folder, "kill", OutputError):
        recover(folder)
        found = state(folder)
        assert found in (before, AFTER)
        outcomes.append(found == AFTER)
        assert not [p for p in folder.iterdir() if p.name.startswith(".")]
        begin(folder)
    assert outcomes == sorted(outcomes)
    assert outcomes.count(False) > 8
    assert outcomes.count(True) > 8


def test_killed_again_while_it_recovers(memory_path):
    folder, count = memory_path / "t", 0
    before = begin(folder)
    for first in crashes(lambda: change(folder), folder, "kill", OutputError):
        kept = memory_path / "kept"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(folder, kept)
        for _ in crashes(lambda: recover(folder), folder, "kill", OutputError):
            recover(folder)
            assert state(folder) in (before, AFTER), first
            count += 1
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        begin(folder)
    assert count > 50


def test_a_full_disk_at_every_file_operation(memory_path):
    folder = memory_path / "t"
    before = begin(folder)
    for _ in crashes(lambda: change(folder), folder, "full", OutputError):
        recover(folder)
        assert state(folder) in (before, AFTER)
        begin(folder)


def test_a_damaged_list_is_explained(memory_path):
    begin(memory_path)
    (memory_path / ".change-commit" / "new").mkdir(parents=True)
    (memory_path / ".change-commit" / "list.json").write_text('{"format": 1, "place": ["../x"], "remove": []}')
    with pytest.raises(OutputError, match="unfinished change"):
        recover(memory_path)


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        "{}",
        '{"format": 2, "place": [], "remove": []}',
        '{"format": 0, "place": [], "remove": []}',
        '{"format": 1, "place": []}',
        '{"format": 1, "place": 3, "remove": []}',
    ],
)
def test_a_list_of_another_kind_is_explained(tmp_path, text):
    before = begin(tmp_path)
    (tmp_path / ".change-commit").mkdir()
    (tmp_path / ".change-commit" / "list.json").write_text(text)
    with pytest.raises(OutputError, match=r"list\.json"):
        recover(tmp_path)
    assert before.items() <= state(tmp_path).items()


def test_what_is_recovered_is_said(tmp_path):
    begin(tmp_path)
    assert recover(tmp_path) is None
    (tmp_path / ".change-next" / "new").mkdir(parents=True)
    assert recover(tmp_path) == f"A change of '{tmp_path}' that had been cut off was undone"
    (tmp_path / ".change-commit" / "new").mkdir(parents=True)
    (tmp_path / ".change-commit" / "new" / "twin.ply").write_text("new")
    (tmp_path / ".change-commit" / "list.json").write_text(
        '{"format": 1, "place": ["twin.ply"], "remove": ["cameras"]}'
    )
    assert recover(tmp_path) == f"A change of '{tmp_path}' that had been cut off was completed"
    assert (tmp_path / "twin.ply").read_text() == "new" and not (tmp_path / "cameras").exists()
    (tmp_path / ".change-commit" / "old").mkdir(parents=True)
    assert recover(tmp_path) is None, "only remains: everything was in its place"
    assert not (tmp_path / ".change-commit").exists()


def test_a_change_may_take_what_an_earlier_one_took_before(tmp_path):
    """`remove` and a folder in the place of a file, and the other way round; twice the same name."""
    begin(tmp_path)
    with changing(tmp_path) as change:
        change.new("cameras").write_text("a file now")
        change.new("cameras").write_text("a file now")
        change.new("twin.ply").mkdir()
        change.remove("report.json")
        change.remove("update.json")
    assert (tmp_path / "cameras").read_text() == "a file now" and (tmp_path / "twin.ply").is_dir()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cameras", "twin.ply"]
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with changing(tmp_path) as change:
        change.remove("link")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cameras", "twin.ply"]


def test_remains_that_cannot_be_removed_are_no_error(tmp_path):
    """A link in the place of the remains: shutil refuses to remove it, and everything was in its place."""
    before = begin(tmp_path / "t")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "t" / COMMIT).symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    assert recover(tmp_path / "t") is None and state(tmp_path / "t") == before
    assert (tmp_path / "elsewhere").is_dir()


def test_a_change_whose_files_are_there_but_not_its_list_is_explained(tmp_path):
    before = begin(tmp_path / "t")
    (tmp_path / "t" / COMMIT / CONTENT).mkdir(parents=True)
    (tmp_path / "t" / COMMIT / CONTENT / "twin.ply").write_text("new")
    with pytest.raises(OutputError, match="it is gone") as error:
        recover(tmp_path / "t")
    assert COMMIT in str(error.value) and "the old ones" in error.value.way_out
    assert {k: v for k, v in state(tmp_path / "t").items() if COMMIT not in k} == before


def test_a_change_that_cannot_be_decided_leaves_the_folder_as_it_was(tmp_path):
    """Something lies where the change would be put at once; the rename fails."""
    before = begin(tmp_path / "t")
    with pytest.raises(OutputError, match="t'"), changing(tmp_path / "t") as new:
        new.new("twin.ply").write_text("new")
        (tmp_path / "t" / COMMIT).mkdir()
        (tmp_path / "t" / COMMIT / "other").write_text("not ours")
    assert {k: v for k, v in state(tmp_path / "t").items() if COMMIT not in k} == before
