"""Looks at watched folders now and then, and starts an update of the twin when new photos are complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError
from ..engine.interpreter import find_python, why_not
from ..paths import absolute, out_folder
from ..watch import Watch, twins_photos
from . import runner
from .request import update_request

#: Seconds between two looks.
SECONDS = 3.0

_watches: dict[str, Watch] = {}


def watch(scene: Any) -> None:
    """Begins or ends watching, as the scene's settings say."""
    _watches.pop(scene.name, None)
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


def look(scene: Any) -> runner.Job | None:
    """Looks at a scene's folder; the update that it started, if any."""
    folder, out = absolute(scene.dgs.new_photos), out_folder(scene.dgs)
    if folder is None or out is None or runner.busy() or not (out / "twin.ply").is_file() or why_not():
        return None
    known = _watches.get(scene.name)
    if known is None or known.folder != folder:
        known = _watches[scene.name] = Watch(folder, twins_photos(out, absolute(scene.dgs.photos)))
    ready = known.look()
    if not ready:
        return None
    known.take(ready)
    try:
        return runner.start(update_request(scene.dgs, ready), find_python(), scene)
    except DgsError as error:
        print(f"Descatter: {folder.name}: {error}", flush=True)
        return None


def _tick() -> float | None:
    watched = [scene for scene in bpy.data.scenes if scene.dgs.watching]
    for scene in watched:
        look(scene)
    return SECONDS if watched else None


def waiting(scene: Any) -> Path | None:
    """The folder that is watched, for the panel."""
    return absolute(scene.dgs.new_photos) if scene.dgs.watching else None
