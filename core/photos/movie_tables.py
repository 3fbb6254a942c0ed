"""What an MP4 or MOV file declares, before a native library believes it.

Its tables (ISO/IEC 14496-12, 8.6 and 8.7) begin with a number of entries. One that the table's own box cannot hold is
damaged or hostile: whoever reads it asks for memory by it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from ..errors import PhotoError

#: Endings of movies that are made of boxes.
BOXED = (".mp4", ".mov", ".m4v")
#: Boxes that hold boxes, on the way to the tables.
_HOLDERS = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts")
#: Tables: where their number of entries stands behind the box's head, and bytes of an entry.
_TABLES = {
    b"stts": (4, 8),
    b"ctts": (4, 8),
    b"stsc": (4, 12),
    b"stco": (4, 4),
    b"co64": (4, 8),
    b"stss": (4, 4),
    b"stsz": (8, 4),
    b"elst": (4, 12),
}
#: Bytes of a box's head, and of one whose size takes 64 bits.
_HEAD, _LONG_HEAD = 8, 16


def check_tables(movie: Path) -> None:
    """Refuses a movie with a table that declares more entries than it can hold.

    Raises:
        PhotoError: such a table. OSError: the file cannot be read.
    """
    with movie.open("rb") as stream:
        size = stream.seek(0, 2)
        for kind, start, end in _boxes(stream, 0, size):
            at, each = _TABLES[kind]
            if start + at + 4 > end:
                continue  # (cut off: it declares nothing)
            stream.seek(start)
            fields = stream.read(at + 4)
            entries = struct.unpack_from(">I", fields, at)[0]
            if kind == b"stsz" and struct.unpack_from(">I", fields, 4)[0]:
                continue  # all samples are of one size: there is no table
            if entries * each > end - start - at - 4:
                raise PhotoError(
                    f"'{movie.name}' is damaged: its table '{kind.decode('ascii')}' declares {entries} entries, which "
                    "it cannot hold",
                    "Export or copy it again",
                )


def _boxes(stream: BinaryIO, start: int, end: int, depth: int = 0) -> Iterator[tuple[bytes, int, int]]:
    """The tables between two places of the file: their kind, and where their content begins and ends."""
    while start + _HEAD <= end:
        stream.seek(start)
        head = stream.read(_LONG_HEAD)
        size, kind = struct.unpack_from(">I4s", head)
        inside = start + _HEAD
        if size == 1 and len(head) == _LONG_HEAD:
            size, inside = struct.unpack_from(">Q", head, _HEAD)[0], start + _LONG_HEAD
        elif size == 0:  # (until the end)
            size = end - start
        if size < inside - start:
            return
        if kind in _TABLES:
            yield kind, inside, min(start + size, end)
        elif kind in _HOLDERS and depth < len(_HOLDERS):
            yield from _boxes(stream, inside, min(start + size, end), depth + 1)
        start += size
