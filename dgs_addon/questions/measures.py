"""Measures of a twin: asked of an engine that has opened its folder, photos and all, and is kept for the next question.

One twin is open at a time. It is opened anew once its files have changed, and closed when nobody has asked for a while.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError, FormatError
from ..engine.conversation import Conversation
from ..engine.interpreter import find_python, why_not
from ..engine.process import RUN
from ..job.results import FOLDER
from ..scene.measures import asked_of, from_file, take_in
from ..scene.twin import is_twin

#: Seconds without a question after which the engine is sent away: it holds all photos.
_IDLE = 600.0
#: Seconds between two looks whether it is so.
_LOOK = 30.0

_open: Conversation | None = None
_subject: tuple[Any, ...] = ()


def measure_command(python: Path, folder: Path) -> list[str]:
    """The engine's command that measures what it is asked line by line."""
    return [str(python), str(RUN), "measure", str(folder), "-", "--progress", "none"]


def mesh_command(python: Path, folder: Path, out: Path, detail: float, faces: int, texture: int) -> list[str]:
    """The engine's command that makes a mesh; `texture`: texels each way, 0 for none."""
    options = ["--out", str(out), "--detail", str(detail), "--faces", str(faces), "--overwrite"]
    options += ["--texture", str(texture)] if texture else []
    return [str(python), str(RUN), "mesh", str(folder), *options, "--progress", "none", "--control"]


def why_no_measure(thing: Any) -> str:
    """Why an object cannot be measured; '' if it can. Cheap enough for a panel."""
    if not is_twin(thing):
        reason = "Select a twin first"
    elif not (Path(str(thing.get(FOLDER, ""))) / "report.json").is_file():
        reason = "This twin has no folder of results, whose photos say how sure a place is"
    else:
        reason = why_not()
    return reason


def folder_of(twin: Any) -> Path:
    """The folder of results that a twin comes from.

    Raises:
        FormatError: it comes from none, or from several.
    """
    folder = Path(str(twin.get(FOLDER, "")))
    if not (folder / "twin.ply").is_file():
        raise FormatError(f"'{twin.name}' has no folder of results", "Add it with Add Twin to Scene")
    from_file(twin)
    return folder


def conversation(twin: Any) -> Conversation:
    """The engine that has this twin open; it starts with the first call, and opens the twin meanwhile.

    Raises:
        DgsError: there is no engine, or the twin comes from no folder.
    """
    global _open, _subject
    folder, python = folder_of(twin), find_python()
    subject = (str(python), str(folder), (folder / "twin.ply").stat().st_mtime_ns)
    if _open is None or _open.error or subject != _subject:
        stop()
        _open, _subject = Conversation(measure_command(python, folder)), subject
        if not bpy.app.background:
            bpy.app.timers.register(_end_if_idle, first_interval=_LOOK, persistent=True)
    return _open


def opening() -> bool:
    """Whether a twin is being opened."""
    return _open is not None and not _open.ready and not _open.error


def ask_again(twin: Any) -> Conversation:
    """Asks for all measures of a twin as they are set now; `answered` takes the answer in."""
    talk = conversation(twin)
    talk.ask("all", asked_of(twin))
    return talk


def answered(twin: Any, answer: dict[str, Any]) -> None:
    """Takes the answer in.

    Raises:
        DgsError: the engine could not follow, in its words.
    """
    if answer.get("event") != "measured":
        raise DgsError(str(answer.get("text") or "The engine's answer is not understood"))
    take_in(twin, answer)


def stop() -> None:
    """Ends the engine's work, as when the add-on is switched off."""
    global _open
    if bpy.app.timers.is_registered(_end_if_idle):
        bpy.app.timers.unregister(_end_if_idle)
    if _open is not None:
        _open.close()
    _open = None


def _end_if_idle() -> float | None:
    if _open is None:
        return None
    if not _open.working and time.monotonic() - _open.asked > _IDLE:
        stop()
        return None
    return _LOOK
