"""What the panel shows of a job: the twin so far above its curves, as images and as one icon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from numpy.typing import NDArray

from . import curve

if TYPE_CHECKING:
    from .runner import Job

RENDER, CURVES = "Descatter Render", "Descatter Curves"
#: Name of the icon with both.
JOB = "Descatter Job"
#: Blender draws icons as squares of this many px: above the twin, below the curves.
SIDE = curve.WIDTH


class _Shown:
    """What is shown now, to draw only what is new."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Nothing is shown."""
        self.icons: Any = None
        self.job: object = None
        self.written: int | None = None
        self.marks = 0
        self.square = np.zeros((SIDE, SIDE, 4), np.float32)


_shown = _Shown()


def icon(name: str) -> int:
    """Icon of JOB or of a picture that `show` was given; 0 if there is none yet."""
    icons = _shown.icons
    return int(icons[name].icon_id) if icons is not None and name in icons else 0


def clear() -> None:
    """Frees the icons, as when the add-on is switched off."""
    if _shown.icons is not None:
        bpy.utils.previews.remove(_shown.icons)
    _shown.reset()


def show(path: Path, name: str) -> Any:
    """Reads a picture into the image `name` and, with a window, into an icon of that name; returns the image."""
    image, pixels = _load(path, name)
    if pixels is not None and not bpy.app.background:
        _set_icon(name, _fitted(pixels, SIDE, SIDE))
    return image


def refresh(job: Job) -> None:
    """Takes in what is new; needs a window."""
    if _shown.job is not job:
        _shown.job, _shown.written, _shown.marks = job, None, 0
        _shown.square[:] = 0.0
    changed = _refresh_render(job.request.out / "snapshot" / "picture.png")
    if len(job.state.marks) != _shown.marks:
        _shown.marks = len(job.state.marks)
        pixels = curve.draw(job.state.marks, job.state.total if job.state.stage == "train" else None)
        _set_image(CURVES, pixels)
        _shown.square[: curve.HEIGHT] = pixels
        changed = True
    if changed:
        _set_icon(JOB, _shown.square)


def _refresh_render(path: Path) -> bool:
    try:
        written = path.stat().st_mtime_ns
    except OSError:
        return False
    if written == _shown.written:
        return False
    _shown.written = written
    pixels = _load(path, RENDER)[1]
    if pixels is None:
        return False
    _shown.square[curve.HEIGHT :] = _fitted(pixels, SIDE, SIDE - curve.HEIGHT)
    return True


def _load(path: Path, name: str) -> tuple[Any, NDArray[np.float32] | None]:
    """The image of this name with a file's content, and its pixels [H, W, 4]; None if it holds none."""
    image = bpy.data.images.get(name)
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name = name
    image.filepath = str(path)
    image.reload()
    width, height = image.size
    if not width or not height:
        return image, None
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return image, pixels.reshape(height, width, 4)


def _fitted(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """[height, width, 4]: the whole picture as large as it fits, in the middle of nothing."""
    scale = min(width / pixels.shape[1], height / pixels.shape[0])
    columns, rows = max(1, int(pixels.shape[1] * scale)), max(1, int(pixels.shape[0] * scale))
    near = pixels[(np.arange(rows) / scale).astype(int)][:, (np.arange(columns) / scale).astype(int)]
    frame = np.zeros((height, width, 4), np.float32)
    top, left = (height - rows) // 2, (width - columns) // 2
    frame[top : top + rows, left : left + columns] = near
    return frame


def _set_image(name: str, pixels: NDArray[np.float32]) -> None:
    height, width = pixels.shape[:2]
    image = bpy.data.images.get(name)
    if image is None or tuple(image.size) != (width, height):
        if image is not None:
            bpy.data.images.remove(image)
        image = bpy.data.images.new(name, width, height, alpha=False)
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()


def _set_icon(name: str, square: NDArray[np.float32]) -> None:
    import bpy.utils.previews  # not loaded by bpy itself

    if _shown.icons is None:
        _shown.icons = bpy.utils.previews.new()
    icons = _shown.icons
    preview = icons[name] if name in icons else icons.new(name)
    preview.image_size = (SIDE, SIDE)
    preview.image_pixels_float.foreach_set(square.reshape(-1))
