"""A child that is started early leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

from dgs.core.sfm.child import Waiting, drop_scratch


def test_folders_go_when_nobody_works_on_them(tmp_path: Path) -> None:
    (tmp_path / ".place-killed").mkdir()
    (tmp_path / ".place-killed" / "native.log").touch()
    child = Waiting(tmp_path, 1)
    try:
        assert child.folder.is_dir() and child.process.poll() is None
        drop_scratch(tmp_path, child)
        assert [p.name for p in tmp_path.iterdir()] == [child.folder.name]
    finally:
        child.end()
        child.end()  # may be said twice
    assert list(tmp_path.iterdir()) == [] and child.process.poll() is not None
    (tmp_path / ".place-killed").mkdir()
    drop_scratch(tmp_path)
    assert list(tmp_path.iterdir()) == []
