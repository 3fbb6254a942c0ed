"""What JPEG leaves of a picture, by Blender's own writer: every Blender has it, Pillow is not everywhere."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import OutputError


def compressed(pixels: NDArray[np.uint8] | NDArray[np.uint16], quality: int) -> NDArray[np.uint8]:
    """[H, W, 3] uint8 after being written as a JPEG of `quality` (1 to 100) and read again."""
    height, width = pixels.shape[:2]
    with tempfile.TemporaryDirectory(prefix="dgs-jpeg-") as folder:
        file = Path(folder) / "photo.jpg"
        image = bpy.data.images.new("photo", width, height, alpha=False, float_buffer=False)
        try:
            image.colorspace_settings.name = "sRGB"
            flat = np.ones((height, width, 4), dtype=np.float32)
            flat[..., :3] = pixels[::-1] / np.float32(255)  # Blender's rows run upwards
            image.pixels.foreach_set(flat.ravel())
            image.file_format = "JPEG"
            image.save(filepath=str(file), quality=quality)
        finally:
            bpy.data.images.remove(image)
        if not file.is_file():
            raise OutputError(f"Blender wrote no JPEG to {file}", "Check the free space")
        read = bpy.data.images.load(str(file))
        try:
            flat = np.empty(width * height * read.channels, dtype=np.float32)
            read.pixels.foreach_get(flat)
            channels = read.channels
        finally:
            bpy.data.images.remove(read)
    values = flat.reshape(height, width, channels)[::-1, :, :3]
    return np.ascontiguousarray(np.rint(values * 255).astype(np.uint8))
