"""Small pictures of the photos, made by Blender in the background."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..dgs_addon.photos import is_movie

#: Photos that are shown: evenly over the set.
SHOWN = 5


class _Collection:
    """Blender's previews of one folder at a time."""

    def __init__(self) -> None:
        self.folder: Path | None = None
        self.previews: Any = None


_held = _Collection()


def thumbnails(folder: Path, files: tuple[Path, ...]) -> list[int]:
    """Icons of a few photos of a folder, or of a movie, as far as they are there already."""
    import bpy.utils.previews  # not loaded by bpy itself

    if _held.folder != folder:
        forget_thumbnails()
        _held.folder, _held.previews = folder, bpy.utils.previews.new()
    count = min(SHOWN, len(files))
    if not files:
        return []
    chosen = [files[round(i * (len(files) - 1) / max(count - 1, 1))] for i in range(count)]
    icons = []
    for path in chosen:
        name = path.name
        if name not in _held.previews:
            _held.previews.load(name, str(path), "MOVIE" if is_movie(path) else "IMAGE")
        icons.append(int(_held.previews[name].icon_id))
    return icons


def forget_thumbnails() -> None:
    """Frees them."""
    if _held.previews is not None:
        bpy.utils.previews.remove(_held.previews)
    _held.folder = _held.previews = None
