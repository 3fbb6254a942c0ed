"""Reads the twin so far, its picture, and the finished twin, on the worker's thread. Knows no Blender."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud
from ...core.errors import DgsError
from ...core.formats.ply import read_ply
from ...core.twin.begun import RUN
from .preview import read_preview


@dataclass(frozen=True)
class News:
    """What is new on the disk.

    Attributes:
        cloud: the latest twin, or None.
        picture: of the twin so far, as `preview.read_preview` makes it, or None.
    """

    cloud: GaussianCloud | None = None
    picture: NDArray[np.float32] | None = None


class SnapshotReader:
    """Reads a twin and its picture when they are new on the disk.

    Args:
        out: folder of the results.
        live: whether the twins of snapshots are wanted; else only the finished twin is read.
        most: Gaussians of a snapshot that are wanted at most; the finished twin is read as it is.
    """

    def __init__(self, out: Path, live: bool, most: int) -> None:
        self.live, self._most = live, most
        snapshot = out / RUN / "snapshot"
        self._final, self._preview = out / "twin.ply", snapshot / "preview.npy"
        self._twins = [self._final, *([snapshot / "twin.ply"] if live else [])]
        self._seen = {path: _time(path) for path in (*self._twins, self._preview)}

    def read_news(self) -> News | None:
        """What is new, or None if nothing is."""
        news = News(self._cloud(), self._picture())
        return None if news.cloud is None and news.picture is None else news

    def _cloud(self) -> GaussianCloud | None:
        for path in self._twins:
            if not self._changed(path):
                continue
            if path == self._final:
                self._twins = [path]  # snapshots are older
            # A damaged file is reported when it is added to the scene.
            with contextlib.suppress(DgsError, OSError):
                cloud = read_ply(path)
                return cloud if path == self._final else thinned(cloud, self._most)
        return None

    def _picture(self) -> NDArray[np.float32] | None:
        if not self._changed(self._preview):
            return None
        with contextlib.suppress(OSError, ValueError):
            return read_preview(self._preview)
        return None

    def _changed(self, path: Path) -> bool:
        written = _time(path)
        if written is None or written == self._seen[path]:
            return False
        self._seen[path] = written
        return True


def thinned(cloud: GaussianCloud, most: int) -> GaussianCloud:
    """At most `most` Gaussians, evenly from all, larger by as much as keeps their surfaces closed."""
    if len(cloud) <= most:
        return cloud
    kept = np.linspace(0, len(cloud) - 1, most).astype(int)
    larger = np.float32(0.5 * np.log(len(cloud) / most))
    return GaussianCloud(
        means=cloud.means[kept],
        log_scales=cloud.log_scales[kept] + larger,
        quaternions=cloud.quaternions[kept],
        opacity_logits=cloud.opacity_logits[kept],
        sh=cloud.sh[kept],
    )


def _time(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None
