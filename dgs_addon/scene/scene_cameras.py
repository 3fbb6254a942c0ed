"""The scene's own cameras as given cameras of a reconstruction."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Any

from ...core.errors import CameraError
from ...core.files import make_folder
from ...core.formats.transforms import write_transforms
from ...core.photos.kinds import HEIF, SUFFIXES
from ..axes import camera_to_engine, read_settings
from ..photos import photo_folder

#: Property of a camera object that names its photo; without it, the object's own name counts.
PHOTO = "dgs_photo"
#: Folder of their file in a folder of results.
SCENE_CAMERAS = "scene_cameras"


def write_scene_cameras(scene: Any, photos: Path | None, out: Path, selection: str = "") -> Path:
    """Writes OUT/scene_cameras/transforms.json with every camera that is named as a photo is.

    Args:
        scene: `bpy` scene.
        photos: folder of the photos.
        out: folder of the results.
        selection: names of the photos that count, one a line; all if empty.

    Raises:
        CameraError: fewer than two photos have a camera, or their size is unknown.
        OutputError: the file cannot be written.
    """
    found = photo_folder(photos, selection) if photos is not None else None
    files = found.files if found is not None else ()
    size = found.size if found is not None else None
    if size is None:
        raise CameraError("The size of the photos cannot be read from their files", "Save them as PNG or JPEG")
    by_stem = {_key(path.name): path.name for path in files}
    placed = {}
    for thing in scene.objects:
        name = by_stem.get(_key(str(thing.get(PHOTO, thing.name)))) if thing.type == "CAMERA" else None
        if name is not None:
            placed[name] = camera_to_engine(read_settings(thing, scene.render), *size, name)
    if len(placed) < 2:
        raise CameraError(
            f"{len(placed)} of {len(files)} photos have a camera of their name in this scene",
            "Name each camera object as its photo",
        )
    path = make_folder(out / SCENE_CAMERAS) / "transforms.json"
    write_transforms(path, placed)
    return path


def _key(name: str) -> str:
    """Photos match cameras whatever the ending and the case."""
    path = Path(name.replace("\\", "/"))
    stem = path.stem if path.suffix.lower() in SUFFIXES | HEIF else path.name
    return unicodedata.normalize("NFC", stem).casefold()
