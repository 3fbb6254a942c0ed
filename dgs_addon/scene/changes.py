"""What this add-on changes of a scene's own settings: noted, so that the panel can say it, and given back when asked.

Notes lie in `scene.dgs.changed`, so that they are saved with the file and follow an undo. Objects that were hidden, and
the camera that was looked through before, are marked themselves: names may change.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from typing import Any

#: Settings that are noted, by their paths from the scene, and what they are called in the panel.
WORDS = {
    "render.engine": "render engine",
    "render.resolution_x": "resolution",
    "render.resolution_y": "resolution",
    "render.resolution_percentage": "resolution",
    "render.film_transparent": "transparent film",
    "render.use_compositing": "compositing",
    "render.pixel_aspect_x": "pixel aspect",
    "render.pixel_aspect_y": "pixel aspect",
    "view_settings.view_transform": "view transform",
    "view_settings.look": "look",
    "cycles.samples": "samples",
    "cycles.preview_samples": "samples",
    "cycles.use_denoising": "denoising",
    "cycles.use_preview_denoising": "denoising",
    "cycles.transparent_max_bounces": "transparent bounces",
    "cycles.min_transparent_bounces": "transparent bounces",
}
CAMERA_WORD = "camera"
#: Object properties: hidden by this add-on (whether renders showed it before); the scene's camera before.
HIDDEN, CAMERA = "dgs_hidden", "dgs_camera_before"
_CAMERA_KEY = "camera"


@contextlib.contextmanager
def noting(scene: Any) -> Iterator[None]:
    """Notes what changes of the scene's settings while entered."""
    before, camera = _settings(scene), scene.camera
    yield
    notes = _notes(scene)
    for path, value in _settings(scene).items():
        old = notes.get(path, [before.get(path)])[0]
        if value == before.get(path):
            continue
        if value == old:
            notes.pop(path, None)
        else:
            notes[path] = [old, value]
    if scene.camera != camera and _CAMERA_KEY not in notes:
        notes[_CAMERA_KEY] = [camera is not None, True]
        if camera is not None:
            camera[CAMERA] = True
    _write(scene, notes)


def hide(thing: Any, scene: Any) -> None:
    """Hides an object from views and renders, as 'H' would: Alt-H shows it again, and so does `give_back`."""
    thing[HIDDEN] = not thing.hide_render
    thing.hide_render = True
    for layer in scene.view_layers:
        if thing.name in layer.objects:
            thing.hide_set(True, view_layer=layer)


def changed_words(scene: Any) -> list[str]:
    """What of the scene's settings is not as it was before, in words, each once."""
    notes = _notes(scene)
    words = [word for path, word in WORDS.items() if path in notes]
    return list(dict.fromkeys([*words, *([CAMERA_WORD] if _CAMERA_KEY in notes else [])]))


def hidden_things(scene: Any) -> list[Any]:
    """The `bpy` objects that this add-on has hidden, by name."""
    return sorted((thing for thing in scene.objects if HIDDEN in thing), key=lambda thing: str(thing.name))


def give_back(scene: Any) -> None:
    """Undoes all that was noted, but for what somebody else has changed since."""
    now = _settings(scene)
    for path, (before, ours) in _notes(scene).items():
        if path in now and now[path] == ours:
            owner, _, name = path.rpartition(".")
            with contextlib.suppress(TypeError, AttributeError):  # a choice that this Blender does not have
                setattr(getattr(scene, owner), name, before)
    if _CAMERA_KEY in _notes(scene):
        scene.camera = next((thing for thing in scene.objects if CAMERA in thing), None)
    for thing in hidden_things(scene):
        thing.hide_render = not thing[HIDDEN]
        for layer in scene.view_layers:
            if thing.name in layer.objects:
                thing.hide_set(False, view_layer=layer)
    forget(scene)


def forget(scene: Any) -> None:
    """Everything stays as it is and counts as the user's own."""
    _write(scene, {})
    for thing in scene.objects:
        for mark in (HIDDEN, CAMERA):
            if mark in thing:
                del thing[mark]


def _settings(scene: Any) -> dict[str, Any]:
    """Their values now, as far as this Blender has them."""
    found = {}
    for path in WORDS:
        owner, _, name = path.rpartition(".")
        group = getattr(scene, owner, None)
        if group is not None and hasattr(group, name):
            found[path] = getattr(group, name)
    return found


def _notes(scene: Any) -> dict[str, list[Any]]:
    """By path: the value before, and the one that was set."""
    settings = getattr(scene, "dgs", None)  # none where the add-on is not registered, as in a script
    try:
        notes = json.loads(settings.changed) if settings is not None and settings.changed else {}
    except (ValueError, RecursionError):  # a file of somebody's, or brackets in brackets
        return {}
    well = isinstance(notes, dict) and all(isinstance(pair, list) and len(pair) == 2 for pair in notes.values())
    return notes if well else {}


def _write(scene: Any, notes: dict[str, list[Any]]) -> None:
    if hasattr(scene, "dgs"):
        scene.dgs.changed = json.dumps(notes) if notes else ""
