"""The states of a twin along the timeline: each is shown from its own frame on, until the next one's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import FormatError
from ...core.files import read_json
from ...core.formats.ply import read_ply
from ...core.twin.folder import TwinFolder
from .twin import add_twin

#: Frames that a state is shown.
FRAMES = 24
#: Object property: which state of which folder.
STATE = "dgs_state"


def add_states(out: Path, scene: Any, first: int = 1, frames: int = FRAMES) -> list[Any]:
    """Adds all kept states of a twin and the present one, with markers on the timeline, in place of those there.

    Another run's twin that stood in the folder before is none of them.

    Args:
        out: folder of a twin; scene: `bpy` scene; first: frame of the oldest state; frames: that each is shown.

    Returns:
        One object per state, oldest first.

    Raises:
        FormatError: the twin has no earlier state, or one is damaged.
    """
    kept = TwinFolder(out).own_states()
    if not kept:
        raise FormatError(f"'{out.name}' has no earlier state", "Update the twin with new photos first")
    folders = [*kept, out]
    clouds = [read_ply(folder / "twin.ply") for folder in folders]  # before anything is taken out
    _remove(out, scene)
    name = f"{_stem(out)} states"
    collection = bpy.data.collections.new(name)
    scene.collection.children.link(collection)
    things = []
    for number, (folder, cloud) in enumerate(zip(folders, clouds, strict=True)):
        thing = add_twin(cloud, f"{name} {number}", collection)
        thing[STATE] = f"{out}#{number}"
        label = f"{_stem(out)} {_label(number, folder)}"
        scene.timeline_markers.new(label, frame=first + number * frames)
        _show_from(thing, first + number * frames, first + (number + 1) * frames, number, len(folders))
        things.append(thing)
    scene.frame_start = min(scene.frame_start, first)
    scene.frame_end = max(scene.frame_end, first + len(folders) * frames - 1)
    scene.frame_set(first)
    return things


def _show_from(thing: Any, begin: int, end: int, number: int, count: int) -> None:
    """Keys of visibility, in viewport and render alike; booleans step from key to key."""
    keys: Sequence[tuple[int, bool]] = [(begin, False)]
    if number > 0:
        keys = [(begin - 1, True), *keys]
    if number < count - 1:
        keys = [*keys, (end, True)]
    for frame, hidden in keys:
        thing.hide_viewport = thing.hide_render = hidden
        for path in ("hide_viewport", "hide_render"):
            thing.keyframe_insert(path, frame=frame)


def _label(number: int, folder: Path) -> str:
    """'state 2: 5 new photos'; the first state is the twin as it was made."""
    try:
        facts = read_json(folder / "update.json")
        return f"state {number}: {len(facts['photos'])} new photos"
    except (OSError, ValueError, KeyError, TypeError):
        return f"state {number}"


def _remove(out: Path, scene: Any) -> None:
    for thing in [o for o in scene.objects if str(o.get(STATE, "")).rpartition("#")[0] == str(out)]:
        mesh, collections = thing.data, list(thing.users_collection)
        bpy.data.objects.remove(thing)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        for collection in collections:
            if collection != scene.collection and not collection.objects:
                bpy.data.collections.remove(collection)
    for marker in [m for m in scene.timeline_markers if m.name.startswith(f"{_stem(out)} state ")]:
        scene.timeline_markers.remove(marker)


def _stem(out: Path) -> str:
    return out.name.removesuffix("-twin") or "twin"
