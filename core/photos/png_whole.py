"""Whether a PNG file is whole, which decoders do not ask: they stop when they have all px, or what they take for them.

Chunks as of the W3C PNG specification, third edition, 5.3.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from ..errors import PhotoError

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def check_png(path: Path) -> None:
    """Refuses a PNG that was cut off, or whose px or header are not those that were written; other files pass.

    Chunks that say something besides the picture may be damaged: nobody reads them.

    Raises:
        PhotoError: it is truncated or damaged. OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            return
        size = path.stat().st_size
        while True:
            head = stream.read(8)
            if len(head) < 8:
                raise PhotoError(f"'{path.name}' is truncated", "Replace or remove the file")
            length, kind = struct.unpack(">I4s", head)
            if length + 4 > size - stream.tell():
                raise PhotoError(f"'{path.name}' is truncated", "Replace or remove the file")
            if kind[0] & 0x20:  # (a small letter: not needed for the picture)
                stream.seek(length + 4, 1)
                continue
            content = stream.read(length)
            if struct.pack(">I", zlib.crc32(content, zlib.crc32(kind))) != stream.read(4):
                named = kind.decode("ascii", "replace")
                raise PhotoError(
                    f"'{path.name}' is damaged (the checksum of its part {named!r} is wrong)",
                    "Replace or remove the file",
                )
            if kind == b"IEND":
                return
