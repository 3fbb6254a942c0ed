"""Where the photos and the results of `scene.dgs` lie, as absolute paths."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from .photos import PhotoFolder, is_movie, photo_folder

#: Bytes of a name and of a path that every system takes, less what is appended to them.
_LONGEST_NAME, _LONGEST_PATH = 240, 3500


def absolute(text: str) -> Path | None:
    """A path property's value; None if it is empty, or no file can be called so. '//' is the .blend's folder."""
    if not text.strip():
        return None
    path = Path(bpy.path.abspath(text))
    longest = max((len(os.fsencode(part)) for part in path.parts), default=0)
    if longest > _LONGEST_NAME or len(os.fsencode(path)) > _LONGEST_PATH:
        return None
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # links that lead to themselves
        return path.absolute()


def out_folder(settings: Any) -> Path | None:
    """Folder for the results of `scene.dgs`: the one that is set, or one beside the photos."""
    chosen = absolute(settings.out)
    if chosen is not None:
        return chosen
    photos = absolute(settings.photos)
    if photos is None:
        return None
    return photos.parent / f"{photos.stem if is_movie(photos) else photos.name}-twin"


def chosen_photos(settings: Any) -> PhotoFolder | None:
    """The photos of `scene.dgs`; None if none are chosen."""
    photos = absolute(settings.photos)
    return None if photos is None else photo_folder(photos, settings.selection)


def pictures_folder(settings: Any) -> Path | None:
    """The folder that holds the photos as files: of a movie, the one that the engine writes its frames to."""
    photos, out = absolute(settings.photos), out_folder(settings)
    return out / "frames" if photos is not None and out is not None and is_movie(photos) else photos
