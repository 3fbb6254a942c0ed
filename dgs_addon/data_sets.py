"""Folders of photos with their cameras, as other programs write them: both become those of a scene.

What lies in such a folder, `core.photos.data_set` says; the command line goes by it, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..core.files import read_json
from ..core.photos.data_set import data_set
from .paths import absolute


def take_data_set(settings: Any) -> None:
    """`scene.dgs.photos` has changed: where it names a data set, its photos and its cameras are taken instead.

    Cameras that came with earlier photos go with them; those that the user named stay.
    """
    folder = absolute(settings.photos)
    found = None if folder is None else data_set(folder)
    if found is not None:
        relative = settings.photos.startswith("//")
        settings.photos = _text(found.photos, relative)  # (is called again, and finds photos)
        take_cameras(settings, found.cameras, relative)
    elif came_with_photos(settings) and not _beside(folder, absolute(settings.model)):
        settings.cameras, settings.model, settings.model_of_set = "photos", "", ""


def take_cameras(settings: Any, cameras: Path, relative: bool = False) -> None:
    """Cameras that lie with the photos become those of step 2."""
    settings.cameras, settings.model = "model", _text(cameras, relative)
    settings.model_of_set = settings.model


def came_with_photos(settings: Any) -> bool:
    """Whether the cameras of step 2 are those of the photos' own data set."""
    return settings.cameras == "model" and bool(settings.model) and settings.model == settings.model_of_set


def cameras_among(folder: Path, names: Sequence[str]) -> Path | None:
    """The first of some files of a folder that holds cameras as a transforms.json does."""
    files = (folder / name for name in names if name.lower().endswith(".json"))
    return next((file for file in files if _has_frames(file)), None)


def _has_frames(path: Path) -> bool:
    try:
        return isinstance(read_json(path)["frames"], list)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _beside(photos: Path | None, model: Path | None) -> bool:
    """Whether photos are those of the data set that a model lies in, or lie in one folder with it."""
    if photos is None or model is None:
        return False
    sets = (data_set(folder) for folder in model.parents[:3])
    return photos == model.parent or any(found is not None and found.photos.resolve() == photos for found in sets)


def _text(path: Path, relative: bool) -> str:
    return bpy.path.relpath(str(path)) if relative else str(path)
