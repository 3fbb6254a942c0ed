"""Files are whole or absent, and a full disk is a sentence."""

import errno
import os
from pathlib import Path

import pytest
from dgs.core.errors import OutputError
from dgs.core.files import check_writable, explaining, make_folder, replacing, write_json, write_text
from dgs.core.transaction import COMMIT, NEXT, changing


def test_writes_and_replaces(tmp_path):
    write_text(tmp_path / "new" / "a ü.txt", "one")
    write_text(tmp_path / "new" / "a ü.txt", "two ü")
    assert (tmp_path / "new" / "a ü.txt").read_text("utf-8") == "two ü"
    assert len(list((tmp_path / "new").iterdir())) == 1


def test_a_full_disk_names_the_file_and_keeps_the_old(tmp_path):
    write_text(tmp_path / "report.json", "old")
    with (
        pytest.raises(OutputError, match=r"report\.json.*no space.*Free some space"),
        replacing(tmp_path / "report.json") as temporary,
    ):
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == "old"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs Linux's /dev/full")
def test_a_really_full_device(tmp_path):
    (tmp_path / "probe").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="twin"), replacing(tmp_path / "twin") as temporary:
        temporary.symlink_to("/dev/full")
        temporary.write_bytes(b"data")


def test_other_errors_pass_and_leave_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "a") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_a_folder(tmp_path):
    (tmp_path / "out").write_text("")
    for act in (make_folder, check_writable):
        with pytest.raises(OutputError, match="out"):
            act(tmp_path / "out")
    check_writable(tmp_path / "fresh")
    assert list((tmp_path / "fresh").iterdir()) == []


def test_json_refuses_what_json_cannot_hold(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"psnr": float("nan")})


def synced(calls, monkeypatch):
    """Notes, beside doing them, what is synced to the disk and what is renamed, in order."""
    fsync, replace, rename = os.fsync, os.replace, os.rename

    def note_sync(handle):
        status = os.fstat(handle)
        calls.append(("sync", os.readlink(f"/proc/self/fd/{handle}"), status.st_size))
        fsync(handle)

    def note(kind, act):
        return lambda a, b: (calls.append((kind, os.fspath(a), os.fspath(b))), act(a, b))[1]

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note("rename", replace))
    monkeypatch.setattr(os, "rename", note("rename", rename))


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="needs Linux's /proc")
def test_content_is_on_the_disk_before_it_takes_its_place_and_the_rename_afterwards(tmp_path, monkeypatch):
    """A power cut in between leaves the old file or the new one, never a name without content."""
    calls = []
    synced(calls, monkeypatch)
    write_text(tmp_path / "a.txt", "twelve bytes")
    (first, temporary, size), (second, source, target), (third, folder, _) = calls
    assert (first, second, third) == ("sync", "rename", "sync")
    assert temporary == source and size == 12
    assert (target, folder) == (str(tmp_path / "a.txt"), str(tmp_path))


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="needs Linux's /proc")
def test_a_change_of_a_folder_is_on_the_disk_before_it_is_decided(tmp_path, monkeypatch):
    with changing(tmp_path) as change:
        change.new("history/000").mkdir()
        for name in ("twin.ply", "history/000/twin.ply"):
            change.new(name).write_text("content")
        calls = []
        synced(calls, monkeypatch)
    decided = next(i for i, (kind, _, to) in enumerate(calls) if kind == "rename" and str(to).endswith(COMMIT))
    content = f"{tmp_path}/{NEXT}/new"
    assert {path for kind, path, _ in calls[:decided] if kind == "sync"} >= {
        content,
        f"{content}/twin.ply",
        f"{content}/history",
        f"{content}/history/000",
        f"{content}/history/000/twin.ply",
    }
    assert calls[decided + 1][:2] == ("sync", str(tmp_path)), "the decision itself lasts"
    placed = [i for i, (kind, _, to) in enumerate(calls) if kind == "rename" and i > decided]
    after = [path for kind, path, _ in calls[placed[-1] :] if kind == "sync"]
    assert len(placed) == 2 and {str(tmp_path), f"{tmp_path}/history"} <= set(after), "and that all is in its place"


def test_scratch_that_finds_no_room_is_explained(tmp_path):
    no_room = r"Cannot write '.*': no room \(120 requested and 60 written\)\. Free some"
    with pytest.raises(OutputError, match=no_room), explaining(tmp_path):
        raise OSError("120 requested and 60 written")  # (as numpy says it, without a number)
    with pytest.raises(OutputError, match="no space left"), explaining(tmp_path):
        Path("/dev/full").write_bytes(b"x")
