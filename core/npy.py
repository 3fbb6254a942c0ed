"""Arrays in numpy's own file format, from anybody."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray


def read_npy(file: IO[bytes], size: int, kinds: str = "uifb") -> NDArray[Any]:
    """One array, at the beginning of a file; no pickle, and no more memory than the file has content.

    Args:
        file: read from its beginning.
        size: bytes in it.
        kinds: of numbers, as numpy calls them.

    Raises:
        ValueError: it is damaged, cut off, or holds no plain numbers.
    """
    version = np.lib.format.read_magic(file)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        shape, by_columns, kind = header(file)
    except (TokenError, RecursionError, MemoryError, TypeError):  # numpy has Python's own parser read it
        raise ValueError("its header is damaged") from None  # (that parser calls deep brackets a lack of memory)
    if kind.kind not in kinds:
        raise ValueError(f"it holds {kind}, not numbers")
    # (bool is a whole number to numpy's check, and its product is what overflows)
    if any(isinstance(side, bool) or side < 0 for side in shape):
        raise ValueError(f"its header declares the shape {shape}")
    count = math.prod(shape)
    if count * kind.itemsize > size:
        raise ValueError(f"it was cut off: its header declares the shape {shape}, which is more than it holds")
    data = file.read(count * kind.itemsize)
    if len(data) < count * kind.itemsize:
        raise ValueError("it was cut off")
    flat = np.frombuffer(data, kind).copy()
    return flat.reshape(shape[::-1]).T if by_columns else flat.reshape(shape)


def load_npy(path: Path) -> NDArray[Any]:
    """The array of a .npy file.

    Raises:
        OSError: it cannot be read. ValueError: see `read_npy`.
    """
    with path.open("rb") as file:
        return read_npy(file, path.stat().st_size)


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive that `numpy.savez` wrote, stored as they are: none is larger than the file.

    Raises:
        OSError: it cannot be read.
        ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError: it is damaged.
    """
    arrays: dict[str, NDArray[Any]] = {}
    with zipfile.ZipFile(path) as archive:
        size = path.stat().st_size
        for entry in archive.infolist():
            if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > size or entry.flag_bits & 1:
                raise ValueError(f"{entry.filename!r} is stored in another way than numpy's")
            with archive.open(entry) as file:
                array = read_npy(file, entry.file_size, "uifbU")
                if file.read(1):  # (at its end the archive compares the checksum)
                    raise ValueError(f"{entry.filename!r} is longer than its array")
            arrays[entry.filename.removesuffix(".npy")] = array
    return arrays
