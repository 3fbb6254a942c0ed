"""Arrays as the files that the engine reads."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from ..core.errors import PhotoError
from ..core.files import make_folder, write_bytes

Picture = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.floating[Any]]


def tiff_bytes(picture: Picture, name: str) -> bytes:
    """A picture as the content of a TIFF file that the engine reads back to the bit.

    Args:
        picture: [H, W], [H, W, 3] or [H, W, 4] uint8, uint16 or floating in [0, 1] (kept as float32); sRGB-encoded.
        name: for the message.

    Raises:
        PhotoError: it has another shape or type.
    """
    array = np.asarray(picture)
    colours = array.shape[2] if array.ndim == 3 else 1
    if array.ndim not in (2, 3) or colours not in (1, 3, 4) or 0 in array.shape:
        raise PhotoError(f"'{name}' of shape {array.shape} is no photo", "Give [height, width, 3]")
    if array.dtype.kind == "f":
        array = array.astype(np.float32)
    elif array.dtype not in (np.uint8, np.uint16):
        raise PhotoError(f"'{name}' of type {array.dtype} is no photo", "Give uint8, uint16 or floats in [0, 1]")
    stream = io.BytesIO()
    extra = {"extrasamples": ["unassalpha"]} if colours == 4 else {}
    kind = "minisblack" if colours == 1 else "rgb"
    tifffile.imwrite(stream, np.ascontiguousarray(array), photometric=kind, metadata=None, **extra)
    return stream.getvalue()


def write_photos(folder: Path, photos: Mapping[str, Picture] | Sequence[Picture]) -> Path:
    """Writes photos into a folder of their own, which is made; what lies there of the same names is replaced.

    Args:
        photos: by file name without suffix; a sequence is numbered: photo_0000, photo_0001, ...

    Raises:
        PhotoError: one is no photo. OutputError: no room, or no permission.
    """
    named = photos if isinstance(photos, Mapping) else {f"photo_{i:04d}": one for i, one in enumerate(photos)}
    make_folder(folder)
    for name, picture in named.items():
        write_bytes(folder / f"{Path(name).stem}.tif", tiff_bytes(picture, name))
    return folder
