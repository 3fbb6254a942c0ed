"""Checks watched folders now and then, and starts an update of the twin when new photos are complete."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError
from ...core.twin.folder import TwinFolder
from ..engine.interpreter import find_python, why_not
from ..paths import absolute, out_folder
from ..photos import suffixes
from . import runner
from .request import update_request

#: Seconds between two checks of a folder: a photo that is still being written must have grown in between.
SECONDS = 3.0


@dataclass
class Watch:
    """What was seen in a folder. A photo is complete when it has not changed between two checks:
    cameras and cloud folders write in pieces.

    Attributes:
        folder: that is watched.
        taken: names that were handed out, or belonged to the twin from the start.
    """

    folder: Path
    taken: set[str] = field(default_factory=set)
    _seen: dict[str, tuple[int, int]] = field(default_factory=dict)

    def new(self) -> list[Path]:
        """Photos that were not handed out, by name, complete or not."""
        return [self.folder / name for name in sorted(self._sizes())]

    def _sizes(self) -> dict[str, tuple[int, int]]:
        now: dict[str, tuple[int, int]] = {}
        kinds = suffixes()
        try:
            for path in self.folder.iterdir():
                if path.suffix.lower() in kinds and not path.name.startswith(".") and path.name not in self.taken:
                    status = path.stat()
                    now[path.name] = (status.st_size, status.st_mtime_ns)
        except OSError:  # the folder is gone for a while, or a file of it
            return {}
        return now

    def complete(self) -> list[Path]:
        """New photos that are complete, by name; none while one of them is still being written."""
        now = self._sizes()
        still = now == self._seen and all(size for size, _ in now.values())
        self._seen = now
        return [self.folder / name for name in sorted(now)] if still else []

    def take(self, photos: Iterable[Path]) -> None:
        """These are dealt with, whatever comes of them: none is tried twice."""
        self.taken.update(path.name for path in photos)


#: By the scenes' `session_uid`: names may change.
_watches: dict[int, Watch] = {}


def watch(scene: Any) -> None:
    """Begins or ends watching, as the scene's settings say."""
    _watches.pop(scene.session_uid, None)
    if scene.dgs.watching and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=SECONDS, persistent=True)


def stop() -> None:
    """No folder is watched any more."""
    _watches.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


@bpy.app.handlers.persistent
def go_on(_file: Any = None) -> None:
    """After another file was loaded: its scenes may watch folders."""
    stop()
    if any(scene.dgs.watching for scene in bpy.data.scenes):
        bpy.app.timers.register(_tick, first_interval=SECONDS, persistent=True)


def check(scene: Any) -> runner.Job | None:
    """Checks a scene's folder; returns the update that it started, if any."""
    folder, out = absolute(scene.dgs.new_photos), out_folder(scene.dgs)
    if folder is None or out is None or runner.busy() or not (out / "twin.ply").is_file() or why_not():
        return None
    watched = _watches.get(scene.session_uid)
    if watched is None or watched.folder != folder:
        watched = _watches[scene.session_uid] = Watch(folder, twins_photos(out, absolute(scene.dgs.photos)))
    ready = watched.complete()
    if not ready:
        return None
    watched.take(ready)
    try:
        return runner.start(update_request(scene.dgs, ready), find_python(), scene)
    except DgsError as error:
        print(f"Descatter: {folder.name}: {error}", flush=True)
        return None


def _tick() -> float | None:
    watched = [scene for scene in bpy.data.scenes if scene.dgs.watching]
    for scene in watched:
        check(scene)
    return SECONDS if watched else None


def twins_photos(out: Path, photos: Path | None) -> set[str]:
    """Names of the photos that the twin in `out` was made from."""
    listed = out / "photos.txt"  # an update's; before the first, the run's own list, or its folder
    try:
        if not listed.is_file():
            listed = Path(TwinFolder(out).report()["settings"]["run"]["photos"])
        if listed.suffix.lower() == ".txt" and listed.is_file():
            return {Path(line).name for line in listed.read_text("utf-8", "replace").splitlines() if line.strip()}
    except (DgsError, OSError):
        pass
    try:
        return {path.name for path in photos.iterdir()} if photos is not None and photos.is_dir() else set()
    except OSError:
        return set()
