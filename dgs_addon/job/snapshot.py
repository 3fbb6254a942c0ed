"""Reads the twin so far, and the finished one, on the worker's thread. Knows no Blender."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ...core.cloud import GaussianCloud
from ...core.errors import DgsError


class SnapshotReader:
    """Tells when a twin is new on the disk, and reads it.

    Args:
        out: folder of the results.
        live: whether snapshots are wanted; else only the finished twin is read.
    """

    def __init__(self, out: Path, live: bool) -> None:
        self.live = live
        self._final = out / "twin.ply"
        self._files = [self._final, *([out / "snapshot" / "twin.ply"] if live else [])]
        self._seen = {path: _time(path) for path in self._files}

    def look(self) -> GaussianCloud | None:
        """The newest twin, or None if there is no news."""
        for path in self._files:
            written = _time(path)
            if written is None or written == self._seen[path]:
                continue
            self._seen[path] = written
            if path == self._final:
                self._files = [path]  # snapshots are older
            # A damaged file is told of when it is added to the scene.
            with contextlib.suppress(DgsError, OSError):
                from ...core.formats.ply import read_ply

                return read_ply(path)
        return None


def _time(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None
