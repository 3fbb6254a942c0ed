"""16-bit PNG, which Pillow can only read as 8 bits (W3C PNG specification, third edition)."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import PhotoError
from .png16_kernels import unfilter

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
#: Nobody's camera makes more; a damaged header could ask for terabytes.
_MAXIMUM_PIXELS = 1 << 28


def read_png16(path: Path) -> NDArray[np.uint16]:
    """[H, W, 1..4] uint16 of a 16-bit PNG that is not interlaced.

    Raises:
        PhotoError: the file is damaged, or interlaced.
    """
    data = path.read_bytes()
    if data[:8] != _SIGNATURE:
        raise PhotoError(f"'{path.name}' is not a PNG file", "Replace or remove the file")
    position, header, packed = 8, b"", bytearray()
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
    if len(header) != 13:
        raise PhotoError(f"'{path.name}' has no PNG header", "Replace or remove the file")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if depth != 16 or colour not in _CHANNELS or not 0 < width * height <= _MAXIMUM_PIXELS:
        raise PhotoError(f"'{path.name}' has a damaged PNG header", "Replace or remove the file")
    if interlaced:
        raise PhotoError(f"'{path.name}' is an interlaced 16-bit PNG", "Save it without interlacing")
    channels = _CHANNELS[colour]
    stride = 1 + 2 * channels * width
    try:
        raw = zlib.decompressobj().decompress(bytes(packed), stride * height)
    except zlib.error as error:
        raise PhotoError(f"'{path.name}' is damaged ({error})", "Replace or remove the file") from error
    if len(raw) != stride * height:
        raise PhotoError(f"'{path.name}' is truncated", "Replace or remove the file")
    rows = np.frombuffer(raw, np.uint8).reshape(height, stride).copy()
    if int(rows[:, 0].max()) > 4:
        raise PhotoError(f"'{path.name}' is damaged (unknown row filter)", "Replace or remove the file")
    unfilter(rows, 2 * channels)
    values = np.ascontiguousarray(rows[:, 1:]).view(">u2").astype(np.uint16)
    return values.reshape(height, width, channels)
