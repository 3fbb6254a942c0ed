"""Two processes never work on one folder."""

from __future__ import annotations

import os
import signal
import time

import pytest
from dgs.core.errors import FolderInUse
from dgs.core.lock import OWNER, locked


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
