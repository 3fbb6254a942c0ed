"""A child that is started early leaves nothing behind."""

from __future__ import annotations

import os
import time
from pathlib import Path

from dgs.core.sfm.child import PATIENCE, Waiting


def test_folders_go_when_nobody_works_on_them(tmp_path: Path) -> None:
    for name in (".place-old", ".place-new"):
        (tmp_path / name).mkdir()
    long_ago = time.time() - 2 * PATIENCE
    os.utime(tmp_path / ".place-old", (long_ago, long_ago))
    child = Waiting(tmp_path, 1)
    try:
        assert child.folder.is_dir() and child.process.poll() is None
        assert {p.name for p in tmp_path.iterdir()} == {".place-new", child.folder.name}
    finally:
        child.end()
        child.end()  # may be said twice
    assert [p.name for p in tmp_path.iterdir()] == [".place-new"] and child.process.poll() is not None
