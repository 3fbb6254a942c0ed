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

    def icon(self, folder: Path, path: Path) -> int:
        """The icon of a file; a small picture comes as soon as Blender has made it."""
        import bpy.utils.previews  # late: bpy itself does not load it, and there is none without a window

        if self.folder != folder:
            self.forget()
            self.folder, self.previews = folder, bpy.utils.previews.new()
        if str(path) not in self.previews:
            self.previews.load(str(path), str(path), "MOVIE" if is_movie(path) else "IMAGE")
        return int(self.previews[str(path)].icon_id)

    def forget(self) -> None:
        """Frees them."""
        if self.previews is not None:
            bpy.utils.previews.remove(self.previews)
        self.folder = self.previews = None


_set, _photos = _Collection(), _Collection()


def thumbnails(folder: Path, files: tuple[Path, ...]) -> list[int]:
    """Icons of a few photos of a folder, or of a movie, as far as they are there already."""
    count = min(SHOWN, len(files))
    chosen = [files[round(i * (len(files) - 1) / max(count - 1, 1))] for i in range(count)]
    return [_set.icon(folder, path) for path in chosen]


def photo_icon(path: Path) -> int:
    """The icon of one photo, wherever it lies."""
    return _photos.icon(path.parent, path)


def forget_thumbnails() -> None:
    """Frees all."""
    _set.forget()
    _photos.forget()
