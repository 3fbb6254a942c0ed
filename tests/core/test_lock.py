"""Two processes never work on one folder."""

from __future__ import annotations

import json
import os
import signal
import time

import pytest
from dgs.core.errors import FolderInUse, OutputError
from dgs.core.lock import LOCK, OWNER, locked, working_on
from dgs.core.transaction import NEXT


def held_by_a_child(folder, seconds: float) -> int:
    """A child that holds the folder's lock; its process id."""
    ready, done = os.pipe()
    child = os.fork()
    if child == 0:
        with locked(folder, "update"):
            os.write(done, b"x")
            time.sleep(seconds)
        os._exit(0)
    os.read(ready, 1)
    return child


def test_the_second_is_refused_by_name(tmp_path):
    child = held_by_a_child(tmp_path, 30)
    with pytest.raises(FolderInUse, match=rf"process {child}, update, since"), locked(tmp_path, "reconstruct"):
        pass
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def test_the_lock_of_a_killed_process_is_taken_over(tmp_path):
    child = held_by_a_child(tmp_path, 30)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert str(child) in (tmp_path / OWNER).read_text("utf-8"), "it died with the lock"
    with locked(tmp_path, "reconstruct"):
        assert str(os.getpid()) in (tmp_path / OWNER).read_text("utf-8")


def test_it_is_free_afterwards_also_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), locked(tmp_path, "reconstruct"):
        raise ZeroDivisionError
    with locked(tmp_path, "reconstruct"):
        pass


def test_the_owner_is_gone_when_the_block_ends_and_may_be_gone_before(tmp_path):
    with locked(tmp_path, "reconstruct"):
        assert json.loads((tmp_path / OWNER).read_text("utf-8"))["task"] == "reconstruct"
    assert not (tmp_path / OWNER).exists()
    with locked(tmp_path, "reconstruct"):
        (tmp_path / OWNER).unlink()
    with locked(tmp_path, "reconstruct"):
        pass


@pytest.mark.parametrize("owner", ["", "{", "[]", "{}", '{"process": "x", "task": 1, "since": 2}', None])
def test_an_owner_that_cannot_be_read_is_not_named(tmp_path, owner):
    """It has only just begun to write, or something else wrote the file."""
    child = held_by_a_child(tmp_path, 30)
    (tmp_path / OWNER).unlink() if owner is None else (tmp_path / OWNER).write_text(owner)
    with pytest.raises(FolderInUse) as caught, locked(tmp_path, "reconstruct"):
        pass
    assert caught.value.what == f"Another process works on '{tmp_path}'"
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def test_a_lock_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "a" / LOCK).mkdir(parents=True)
    with pytest.raises(OutputError, match=r"a/\.lock"), locked(tmp_path / "a", "reconstruct"):
        pass
    (tmp_path / "b" / OWNER).mkdir(parents=True)
    for _ in range(2):  # (who works there is only a kindness: nobody is kept out for want of it)
        with locked(tmp_path / "b", "reconstruct"):
            pass


def test_what_was_left_behind_is_said_when_a_folder_is_worked_on(tmp_path):
    notes = []
    with working_on(tmp_path, "update", notes.append):
        assert notes == []
    (tmp_path / NEXT).mkdir()
    with working_on(tmp_path, "update", notes.append):
        assert not (tmp_path / NEXT).exists()
    assert notes == [f"A change of '{tmp_path}' that had been cut off was undone"]


def test_nobody_waits_unasked(tmp_path):
    child = held_by_a_child(tmp_path, 30)
    for wait, least, most in ((None, 0.0, 0.5), (0.7, 0.7, 5.0)):
        began = time.perf_counter()
        with pytest.raises(FolderInUse), working_on(tmp_path, "update", print, *([] if wait is None else [wait])):
            pass
        assert least <= time.perf_counter() - began < most
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
