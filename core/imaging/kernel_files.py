"""Reads a point spread function from NPY, TIFF, PNG or FITS, as linear values."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import PsfError
from ..npy import load_npy

#: Bytes of a block: the FITS standard's.
_FITS_BLOCK = 2880
_FITS_TYPES = {8: ">u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}
#: Bytes; no point spread is that large, and a wrong file should not fill the memory.
_LARGEST_FILE = 256 * 2**20


def read_kernel(path: Path) -> NDArray[np.float64]:
    """[K, L] float64, the file's values as they stand; row 0 is the first row stored.

    Pictures are read without any gamma; colour pictures must have equal channels. FITS is read as
    stored, which viewers show upside down: the order of rows is that of the array.

    Raises:
        PsfError: missing, damaged, of another kind, or not one channel.
    """
    try:
        there = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        raise PsfError(f"There is no PSF file '{path}'", "Check the path after file:")
    if path.stat().st_size > _LARGEST_FILE:
        raise PsfError(f"The PSF file '{path}' is larger than 256 MiB", "Crop it around the point of light")
    readers = {
        ".npy": load_npy,
        ".tif": _read_tiff,
        ".tiff": _read_tiff,
        ".png": _read_png,
        ".fits": _read_fits,
        ".fit": _read_fits,
        ".fts": _read_fits,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise PsfError(f"The PSF file '{path}' is of no known kind", "Save it as NPY, TIFF, PNG or FITS")
    try:
        values = np.squeeze(np.asarray(reader(path)))
    except PsfError:
        raise
    except Exception as error:  # (decoders raise whatever they like; the file's name is what helps)
        raise PsfError(f"The PSF file '{path}' cannot be read: {_reason(error)}", "Save it again") from error
    if values.dtype.kind not in "uifb":
        raise PsfError(f"The PSF file '{path}' holds {values.dtype}, not numbers", "Save real numbers")
    return _single_channel(np.atleast_2d(values).astype(np.float64), path)


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__


def _single_channel(values: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    if values.ndim == 3 and values.shape[2] in (2, 3, 4):
        colours = values[:, :, : 1 if values.shape[2] == 2 else 3]  # what is left out is alpha
        if np.ptp(colours, axis=2).max() <= 1e-6 * np.abs(colours).max():
            return np.ascontiguousarray(colours[:, :, 0])
        raise PsfError(f"The PSF file '{path}' is coloured", "Save one channel: one PSF serves all channels")
    if values.ndim != 2:
        raise PsfError(f"The PSF file '{path}' has shape {values.shape}", "Save one two-dimensional kernel")
    return values


def _read_tiff(path: Path) -> Any:
    import tifffile  # late: only for TIFF files

    with tifffile.TiffFile(path) as file:
        if not len(file.pages):
            raise ValueError("it holds no picture")
        page = file.pages[0]
        _check_size(max(math.prod(page.shape), math.prod(getattr(page, "chunks", ()))) * 8)
        return page.asarray()


def _read_png(path: Path) -> Any:
    from PIL import Image  # heavy: pictures only

    with Image.open(
        io.BytesIO(path.read_bytes())
    ) as file:  # (a file would give memory for any length that it declares)
        if file.format != "PNG":
            raise PsfError(f"The PSF file '{path}' is {file.format}, not PNG", "Save it as PNG")
        _check_size(math.prod(file.size) * 4)
        picture: Image.Image = file
        if picture.mode == "P" or picture.mode == "1":
            picture = picture.convert("L")
        if picture.mode not in ("L", "I;16", "I", "RGB", "RGBA", "LA"):
            raise PsfError(f"The PSF file '{path}' has mode {picture.mode}", "Save it as grey, 8 or 16 bit")
        return np.array(picture)


def _check_size(size: int) -> None:
    """Refuses a picture that would fill the memory, however small its file is."""
    if size > _LARGEST_FILE:
        raise ValueError(f"it declares a picture of {size // 2**20} MiB")


def _read_fits(path: Path) -> Any:
    """The primary array (FITS standard 4.0, sections 3.3, 4.4 and 5), without extensions."""
    data = path.read_bytes()
    header: dict[str, str] = {}
    for start in range(0, len(data), 80):
        card = data[start : start + 80].decode("ascii", "replace")
        keyword = card[:8].rstrip()
        if keyword == "END":
            break
        if card[8:10] == "= ":
            header.setdefault(keyword, card[10:].split("/")[0].strip())
    else:
        raise PsfError(f"The PSF file '{path}' is not FITS", "Save it as FITS with a primary array")
    if header.get("SIMPLE") != "T" or int(header.get("NAXIS", "0")) < 1:
        raise PsfError(f"The PSF file '{path}' has no primary array", "Save the kernel in the primary HDU")
    begin = -(-(start + 80) // _FITS_BLOCK) * _FITS_BLOCK
    shape = [int(header[f"NAXIS{axis}"]) for axis in range(int(header["NAXIS"]), 0, -1)]
    if min(shape) < 1:
        raise ValueError(f"its array has the shape {tuple(shape)}")
    values = np.frombuffer(data, _FITS_TYPES[int(header["BITPIX"])], int(np.prod(shape)), begin)
    scale, zero = (float(header.get(k, d).replace("D", "E")) for k, d in (("BSCALE", "1"), ("BZERO", "0")))
    return values.reshape(shape).astype(np.float64) * scale + zero
