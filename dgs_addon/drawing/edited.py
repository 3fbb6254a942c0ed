"""Twins in Edit Mode: their splats go on being drawn, as they are edited, with what is selected tinted.

What is edited is read by a timer, after it was drawn: nothing may be changed while Blender draws, and reading makes
Blender bring its own copy up to date. A large twin that is moved is read no more often than a share of the time.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..scene.reading import readable
from ..scene.twin import TWIN, is_twin
from ..window import redraw_views
from .contents import content_of
from .held_twins import TwinStore

#: A read is followed by no other for so many times the time that it took.
_REST = 3.0
#: States of a twin that pictures on their way may still need.
_STATES = 3


@dataclass
class _Edit:
    """One mesh in Edit Mode, and who draws it."""

    server: TwinStore
    key: str | None = None
    changed: bool = True
    earlier: deque[str] = field(default_factory=deque)
    rests_until: float = 0.0


_edits: dict[int, _Edit] = {}


def edited_key(twin: Any, server: TwinStore) -> str | None:
    """The key of the last state of an edited twin that was read; None where there is none yet, '' if it is empty."""
    edit = _edits.setdefault(twin.data.session_uid, _Edit(server))
    edit.server = server
    edit.changed |= bool(edit.key) and not server.has(str(edit.key))
    if edit.changed and not bpy.app.timers.is_registered(_read):
        bpy.app.timers.register(_read, first_interval=max(0.0, edit.rests_until - time.monotonic()))
    return edit.key


def final_key(twin: Any, server: TwinStore) -> str | None:
    """The key of an edited twin as it is now, without any tint; None where nothing of it is to be seen."""
    with readable(twin) as mesh:
        content = content_of(mesh, twin.data.session_uid, int(twin[TWIN]))
    if content is not None:
        server.put(*content)
    return None if content is None else content[0].key


def note_change(number: int) -> None:
    """A mesh in Edit Mode has changed, or what is selected of it."""
    if number in _edits:
        _edits[number].changed = True


def forget_edits() -> None:
    """Drops what is held of meshes that were edited."""
    if bpy.app.timers.is_registered(_read):
        bpy.app.timers.unregister(_read)
    _edits.clear()


def _read() -> None:
    twins = {thing.data.session_uid: thing for thing in bpy.data.objects if is_twin(thing) and thing.data.is_editmode}
    for gone in _edits.keys() - twins.keys():
        del _edits[gone]
    for number, edit in _edits.items():
        if edit.changed:
            began = time.monotonic()
            _take(edit, twins[number], edit.server)
            edit.rests_until = time.monotonic() + _REST * (time.monotonic() - began)
            redraw_views()


def _take(edit: _Edit, twin: Any, server: TwinStore) -> None:
    with readable(twin) as mesh:
        content = content_of(mesh, twin.data.session_uid, int(twin[TWIN]), tinted=True)
    edit.changed = False
    if content is None:
        edit.key = ""
        return
    server.put(*content)
    if content[0].key != edit.key:
        edit.key = content[0].key
        edit.earlier.append(content[0].key)
        if len(edit.earlier) > _STATES:
            server.retire(edit.earlier.popleft())
