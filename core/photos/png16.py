"""16-bit PNG, which Pillow can only read as 8 bits (W3C PNG specification, third edition)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import PhotoError
from .png16_kernels import unfilter

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: Channels of each colour type: the PNG standard's.
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
#: Nobody's camera makes more; a damaged header could ask for terabytes.
_MAXIMUM_PIXELS = 1 << 28


@dataclass(frozen=True)
class _Header:
    """Size in px, and channels per px."""

    width: int
    height: int
    channels: int

    @property
    def stride(self) -> int:
        """Bytes of a row: its filter, then two for each value."""
        return 1 + 2 * self.channels * self.width


def read_png16(path: Path) -> NDArray[np.uint16]:
    """[H, W, 1..4] uint16 of a 16-bit PNG that is not interlaced.

    Raises:
        PhotoError: the file is damaged, or interlaced.
    """
    data = path.read_bytes()
    if data[:8] != _SIGNATURE:
        raise PhotoError(f"'{path.name}' is not a PNG file", "Replace or remove the file")
    chunk, packed = _chunks(data)
    header = _header(chunk, path.name)
    try:
        raw = zlib.decompressobj().decompress(bytes(packed), header.stride * header.height)
    except zlib.error as error:
        raise PhotoError(f"'{path.name}' is damaged ({error})", "Replace or remove the file") from error
    if len(raw) != header.stride * header.height:
        raise PhotoError(f"'{path.name}' is truncated", "Replace or remove the file")
    rows = np.frombuffer(raw, np.uint8).reshape(header.height, header.stride).copy()
    if int(rows[:, 0].max()) > 4:
        raise PhotoError(f"'{path.name}' is damaged (unknown row filter)", "Replace or remove the file")
    unfilter(rows, 2 * header.channels)
    values = np.ascontiguousarray(rows[:, 1:]).view(">u2").astype(np.uint16)
    return values.reshape(header.height, header.width, header.channels)


def _chunks(data: bytes) -> tuple[bytes, bytearray]:
    """The header's bytes, and all compressed pixels, up to the file's end or where it was cut."""
    position, header, packed = len(_SIGNATURE), b"", bytearray()
    while position + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[position : position + 8])
        body = data[position + 8 : position + 8 + length]
        if len(body) < length:
            break
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed += body
        elif kind == b"IEND":
            break
        position += 12 + length
    return header, packed


def _header(chunk: bytes, name: str) -> _Header:
    """The header, if this file can read such a picture."""
    if len(chunk) != 13:
        raise PhotoError(f"'{name}' has no PNG header", "Replace or remove the file")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunk)
    if depth != 16 or colour not in _CHANNELS or not 0 < width * height <= _MAXIMUM_PIXELS:
        raise PhotoError(f"'{name}' has a damaged PNG header", "Replace or remove the file")
    if interlaced:
        raise PhotoError(f"'{name}' is an interlaced 16-bit PNG", "Save it without interlacing")
    return _Header(width, height, _CHANNELS[colour])
