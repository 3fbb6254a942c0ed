"""Where a scene's photos and results lie, as absolute paths."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from .photos import is_movie


def absolute(text: str) -> Path | None:
    """A path property's value; None if it is empty. '//' is the .blend's folder."""
    return Path(bpy.path.abspath(text)).resolve() if text.strip() else None


def out_folder(settings: Any) -> Path | None:
    """Folder for the results of `scene.dgs`: the one that is set, or one beside the photos."""
    chosen = absolute(settings.out)
    if chosen is not None:
        return chosen
    photos = absolute(settings.photos)
    if photos is None:
        return None
    return photos.parent / f"{photos.stem if is_movie(photos) else photos.name}-twin"
