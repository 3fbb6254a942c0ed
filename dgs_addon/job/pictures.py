"""What the panel shows of a job: the twin so far above its curves, as one icon and as two images.

The icon is the panel's alone, so that a new one costs a drawing of the sidebar. A changed image makes
Blender draw every 3D view, which takes far longer: images follow only while an editor shows them, and
at the end.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.twin.begun import RUN
from .job import Job
from .preview import HEIGHT, SIDE, draw_curves, fitted

RENDER, CURVES = "Descatter Render", "Descatter Curves"
#: Name of the icon with both.
JOB = "Descatter Job"


class _Shown:
    """What is shown now, to draw only what is new."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Nothing is shown."""
        self.icons: Any = None
        self.job: object = None
        self.picture: object = None
        self.drawn = False
        self.marks = 0
        self.image_written: tuple[Path, int] | None = None
        self.image_marks = 0
        self.square = np.zeros((SIDE, SIDE, 4), np.float32)


_shown = _Shown()


def icon(name: str) -> int:
    """Icon of JOB or of a picture that `show_image` was given; 0 if there is none yet."""
    icons = _shown.icons
    return int(icons[name].icon_id) if icons is not None and name in icons else 0


def shows(job: Job) -> bool:
    """Whether the icon JOB is of this job already, and not of the one before."""
    return _shown.job is job and _shown.drawn


def clear() -> None:
    """Frees the icons, as when the add-on is switched off."""
    if _shown.icons is not None:
        bpy.utils.previews.remove(_shown.icons)
    _shown.reset()


def show_image(image: Any, name: str) -> None:
    """Makes an icon of this name of an image; needs a window."""
    pixels = _pixels(image)
    if pixels is not None:
        _set_icon(name, fitted(pixels, SIDE, SIDE))


def refresh(job: Job) -> None:
    """Takes in what is new; needs a window."""
    if _shown.job is not job:
        _shown.job, _shown.picture, _shown.marks, _shown.drawn = job, None, 0, False
        _shown.image_written, _shown.image_marks = None, 0
        _shown.square[:] = 0.0
    changed = job.picture is not None and job.picture is not _shown.picture
    if changed:
        _shown.picture = job.picture
        _shown.square[HEIGHT:] = job.picture
    if len(job.state.marks) != _shown.marks:
        _shown.marks = len(job.state.marks)
        _shown.square[:HEIGHT] = _curves(job)
        changed = True
    if changed:
        _set_icon(JOB, _shown.square)
        _shown.drawn = True
    _refresh_images(job)


def _curves(job: Job) -> NDArray[np.float32]:
    return draw_curves(job.state.marks, job.state.total if job.state.stage == "train" else None)


def _refresh_images(job: Job) -> None:
    editors = _editors()
    if _shown.image_marks != _shown.marks and _wanted(CURVES, job, editors):
        _shown.image_marks = _shown.marks
        _set_image(CURVES, _curves(job))
    out = job.request.out
    path = next((p for p in (out / RUN, out) if (p / "snapshot").is_dir()), out) / "snapshot" / "picture.png"
    if _shown.picture is not None and _wanted(RENDER, job, editors):
        written = _time(path)
        if written is not None and (path, written) != _shown.image_written:
            _shown.image_written = path, written
            with contextlib.suppress(RuntimeError):  # it has just gone, or is no picture
                _load(path, RENDER)


def _wanted(name: str, job: Job, editors: list[Any]) -> bool:
    """A new image makes Blender draw all views, eight times over: it comes only where there is an editor to show it."""
    if not job.state.alive:
        return True
    if name not in bpy.data.images:
        return bool(editors)
    return any(editor.image is not None and editor.image.name == name for editor in editors)


def _editors() -> list[Any]:
    return [
        area.spaces.active
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "IMAGE_EDITOR"
    ]


def _time(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None


def _load(path: Path, name: str) -> Any:
    """The image of this name with a file's content."""
    image = bpy.data.images.get(name)
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name = name
    image.filepath, image.source = str(path), "FILE"
    image.reload()
    return image


def _pixels(image: Any) -> NDArray[np.float32] | None:
    """[H, W, 4], rows upwards; None if it holds none."""
    width, height = image.size
    if not width or not height:
        return None
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


def _set_image(name: str, pixels: NDArray[np.float32]) -> None:
    height, width = pixels.shape[:2]
    image = bpy.data.images.get(name)
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=False)
    elif tuple(image.size) != (width, height):
        image.scale(width, height)  # whatever else shows it goes on doing so
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()


def _set_icon(name: str, square: NDArray[np.float32]) -> None:
    import bpy.utils.previews  # late: bpy itself does not load it, and there is none without a window

    if _shown.icons is None:
        _shown.icons = bpy.utils.previews.new()
    icons = _shown.icons
    preview = icons[name] if name in icons else icons.new(name)
    preview.image_size = (SIDE, SIDE)
    preview.image_pixels_float.foreach_set(square.reshape(-1))
