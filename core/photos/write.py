"""Pictures that the program writes, and what they are called."""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..files import write_bytes


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Writes [H, W, 3 or 4] uint8, whole or not at all; raises OutputError."""
    write_bytes(path, png_bytes(pixels))


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """[H, W, 3 or 4] uint8 as the content of a PNG file, as `write_png` writes it."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", compress_level=4)
    return stream.getvalue()


def photo_stem(name: str) -> str:
    """What two files of the same photo share: the name without its extension, whatever its case."""
    return unicodedata.normalize("NFC", Path(name).stem).casefold()


def render_names(names: Sequence[str]) -> dict[str, str]:
    """Render's file name by view: the photo's, as PNG; photos that differ only in their extension keep it."""
    stems = [photo_stem(name) for name in names]
    return {name: f"{Path(name).stem}.png" if stems.count(photo_stem(name)) == 1 else f"{name}.png" for name in names}
