"""Several sets of photos, one twin each: the engine's own command for it, beside Blender. One at a time."""

from __future__ import annotations

import queue
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError
from ...core.json_shape import check_shape, number, sentence, text
from ...core.photos.data_set import photos_in
from ..engine.process import RUN
from ..paths import absolute
from ..photos import photo_folder
from ..window import redraw
from .options import OPTIONS, Options
from .request import shared_options
from .worker import Ended, Worker

#: Seconds between two readings of what the engine says.
_TICK = 0.5
#: Options of a run that the command has for all sets.
_SHARED = (
    *("psf", "blur_space", "background", "max_size", "preset", "holdout_every", "seed", "max_gaussians", "effects"),
    *("adjust_cameras", "refine_cameras", "time_limit", "sh_degree", "device", "threads"),
)
#: What is read of a line of the table.
_LINE = {"photos": text, "out": text, "how": text, "why": sentence, "registered": sentence, "psnr?": (number,)}
#: Endings of folders that hold results, and not photos.
_RESULTS = "-twin"


@dataclass
class Batch:
    """One run over several sets.

    Attributes:
        worker: the engine's process; folders: the sets, in their order.
        alive: whether it works; asked: whether it was asked to stop.
        note, stage: what happens now.
        lines: the table at the end, as `command_line.batch_command` makes it: dictionaries.
        error: why it ended, in one line; '' if all went well.
    """

    worker: Worker
    folders: list[Path]
    alive: bool = True
    asked: bool = False
    note: str = ""
    stage: str = ""
    lines: list[dict[str, Any]] = field(default_factory=list)
    error: str = ""


_batch: Batch | None = None


def current() -> Batch | None:
    """The batch that runs or ran last in this Blender."""
    return _batch


def running() -> bool:
    """Whether one works now."""
    return _batch is not None and _batch.alive


def photo_sets(parent: Path) -> list[Path]:
    """Folders in a folder that hold photos enough for a twin, or a data set with them, by name; results are none.

    Raises:
        DgsError: it cannot be read.
    """
    try:
        inner = sorted(path for path in parent.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError as error:
        raise DgsError(f"The folder '{parent}' cannot be read ({error.strerror})", "Choose another") from error
    return [path for path in inner if not path.name.endswith(_RESULTS) and not photo_folder(photos_in(path)).problem]


def batch_command(python: Path, folders: list[Path], options: Options) -> list[str]:
    """The engine's command line; `options` as of a job, of which those count that all sets can share."""
    words = [str(python), str(RUN), "batch", *map(str, folders)]
    for name in _SHARED:
        if name in options:
            value = OPTIONS[name].write(options[name])
            words += [OPTIONS[name].flag, value] if value else [OPTIONS[name].flag]
    return [*words, "--progress", "json", "--control"]


def start(folders: list[Path], settings: Any, python: Path) -> Batch:
    """Starts the engine; returns at once.

    Raises:
        DgsError: one runs already, or a setting of the medium cannot be used.
    """
    global _batch
    if running():
        raise DgsError("A batch is running already", "Wait for it or cancel it")
    command = batch_command(python, folders, shared_options(settings))
    log = Path(bpy.app.tempdir or tempfile.gettempdir()) / "descatter_batch.log"
    _batch = Batch(Worker(command, log), folders)
    _batch.worker.start()
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_TICK, persistent=True)
    return _batch


def cancel() -> None:
    """Asks it to stop: what is done is kept. A second call ends it at once."""
    if _batch is not None and _batch.alive:
        if _batch.asked:
            _batch.worker.kill()
        _batch.asked = True
        _batch.worker.send("cancel")


def wait(seconds: float = float("inf")) -> bool:
    """Waits for its end, for Blender without a window; False if it did not come in time."""
    until = time.monotonic() + seconds
    while running():
        if time.monotonic() > until:
            return False
        _drain()
        time.sleep(0.05)
    return True


def stop() -> None:
    """Ends it at once, as when the add-on is switched off; finished twins and checkpoints stay."""
    global _batch
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    if _batch is not None and _batch.alive:
        _batch.worker.kill()
        _batch.worker.join(5.0)
    _batch = None


def _tick() -> float | None:
    if _batch is None:
        return None
    if _drain():
        redraw()
    return _TICK if _batch.alive else None


def _drain() -> bool:
    """Takes in what the engine has said; True if the panel would show it."""
    batch, news = _batch, False
    assert batch is not None
    while True:
        try:
            message = batch.worker.events.get_nowait()
        except queue.Empty:
            return news
        if isinstance(message, Ended):
            batch.alive, news = False, True
        elif isinstance(message, dict):
            news |= _apply(batch, message)


def _apply(batch: Batch, event: dict[str, Any]) -> bool:
    kind = event.get("event")
    if kind == "note":
        batch.note = str(event.get("text"))
    elif kind == "stage":
        batch.stage = str(event.get("name"))
    elif kind == "error":
        batch.error = str(event.get("text"))
    elif kind == "done":
        lines = event.get("result", {}).get("sets") if isinstance(event.get("result"), dict) else None
        try:
            check_shape(lines, [_LINE])
            batch.lines = lines or []
        except ValueError as error:
            batch.error = f"The engine's answer is not understood: {error}"
    else:
        return False
    return True


def absolute_sets(directory: str) -> list[Path]:
    """`photo_sets` of a folder that a user chose; raises DgsError where there are none."""
    parent = absolute(directory)
    sets = photo_sets(parent) if parent is not None else []
    if not sets:
        raise DgsError(
            f"No folder in '{directory}' holds photos", "Choose a folder with a folder for each set of photos"
        )
    return sets
