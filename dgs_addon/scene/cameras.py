"""Cameras of a file in a Blender scene, each with its photo behind it.

Blender's cameras are pinholes: they get a lens's focal length and principal point. A photo with strong
distortion therefore lies exactly behind the twin only at its centre. A pixel aspect belongs to the
scene's render settings in Blender, so that the first camera sets it for all.
"""

from __future__ import annotations

import unicodedata
from collections import Counter
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import FormatError
from ...core.formats.cameras import read_cameras
from ...core.photos.kinds import SUFFIXES
from ..axes import place_camera
from .medium import FOCAL
from .removal import take_out
from .scene_cameras import PHOTO

#: Pictures that Blender can show behind a camera.
_PHOTOS = SUFFIXES | {".exr"}


def add_cameras(path: Path, photos: Path | None, scene: Any, into: Any = None) -> list[Any]:
    """Adds every camera of a model, in a collection of its own, and looks through the first.

    Args:
        path: a file of cameras or a folder with one, of any format of `core.formats.cameras`.
        photos: folder with the photos, matched by name without regard to case and ending; None for none. Where the
            model has two photos of one name in two folders, each is looked for in its own.
        scene: `bpy` scene; gets the frame size of the first camera.
        into: collection of an earlier call: its cameras are moved to where they are now, those that the model has no
            more are taken out. What else looks through them or stands in it stays, and so do the scene's camera and
            frame size.

    Returns:
        The `bpy` camera objects by sorted photo name, without parents.

    Raises:
        FormatError: no cameras there, or damaged ones.
    """
    cameras = read_cameras(path).pinholes()
    pictures = _pictures(photos, sorted(cameras)) if photos is not None else {}
    alike = Counter(map(_key, cameras))
    collection, before = into, {} if into is None else _by_photo(into)
    if collection is None:
        collection = bpy.data.collections.new("Cameras")
        scene.collection.children.link(collection)
    objects: list[Any] = []
    for name in sorted(cameras):
        label = Path(name).stem if alike[_key(name)] == 1 else str(Path(name).with_suffix(""))
        thing = before.pop(name, None) or _empty_camera(label, name, collection)
        thing.parent = None
        place_camera(thing, cameras[name])
        thing[FOCAL] = float(cameras[name].fx)
        picture = pictures.get(name)
        if picture is not None and not thing.data.background_images:
            _show_behind(thing.data, picture)
        objects.append(thing)
    for thing in before.values():
        take_out(thing, collection)
    size = _display_size(objects)
    for thing in objects:
        thing.data.display_size = size
    if into is None or scene.camera is None:
        place_camera(objects[0], cameras[min(cameras)], scene.render)
        scene.camera = objects[0]
    return objects


def _by_photo(collection: Any) -> dict[str, Any]:
    """The cameras in a collection by their photos' names; of a camera and its copies, the first."""
    found: dict[str, Any] = {}
    for thing in collection.objects:
        if thing.type == "CAMERA" and PHOTO in thing:
            found.setdefault(str(thing[PHOTO]), thing)
    return found


def _empty_camera(label: str, photo: str, collection: Any) -> Any:
    thing = bpy.data.objects.new(label, bpy.data.cameras.new(label))
    collection.objects.link(thing)
    thing[PHOTO] = photo
    return thing


def new_camera(name: str, scene: Any) -> Any:
    """A `bpy` camera object that the scene looks through."""
    thing = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    scene.collection.objects.link(thing)
    scene.camera = thing
    return thing


def photo_behind(camera: Any) -> Path | None:
    """The photo that a recovered camera shows behind the scene; None if it has none, or it is gone."""
    pictures = camera.data.background_images if camera is not None and camera.type == "CAMERA" else ()
    for picture in pictures:
        if picture.image is not None and picture.image.filepath:
            path = Path(bpy.path.abspath(picture.image.filepath))
            return path if path.is_file() else None
    return None


def _pictures(folder: Path, names: list[str]) -> dict[str, Path]:
    """The pictures in a folder by the names of the cameras that took them."""
    try:
        there = {_key(file.name): file for file in sorted(folder.iterdir()) if file.suffix.lower() in _PHOTOS}
    except OSError as error:
        raise FormatError(f"The photos in '{folder}' cannot be listed", "Choose another folder") from error
    alike = Counter(map(_key, names))
    found: dict[str, Path] = {}
    for name in names:
        picture = there.get(_key(name)) if alike[_key(name)] == 1 else folder / name
        if picture is not None and picture.is_file() and picture.suffix.lower() in _PHOTOS:
            found[name] = picture
    return found


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", Path(name.replace("\\", "/")).stem).casefold()


def _show_behind(data: Any, picture: Path) -> None:
    background = data.background_images.new()
    # Opened when it is drawn: hundreds of photos must not fill the memory now.
    background.image = bpy.data.images.load(str(picture), check_existing=True)
    background.alpha = 0.5
    background.display_depth = "FRONT"
    background.frame_method = "FIT"
    data.show_background_images = True


def _display_size(objects: list[Any]) -> float:
    """Camera cones of about half the distance between neighbours, whatever the model's unit is."""
    centres = [thing.matrix_world.translation for thing in objects]
    gaps = sorted((a - b).length for a, b in zip(centres, centres[1:], strict=False))
    gap = gaps[len(gaps) // 2] if gaps else 0.0
    return 0.5 * gap if gap > 1e-6 else 1.0
