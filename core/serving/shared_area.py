"""Memory that two processes see.

It has no name that could be left behind: on POSIX it is a file without a name, whose descriptor the other process
inherits; on Windows a mapping of the page file. When both processes have ended, however they end, it is gone.
"""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
import uuid

from ..errors import DgsError

#: Bytes of a new area; it grows to the next power of two, so that it is seldom mapped anew.
_LEAST = 2**20


class SharedArea:
    """A row of bytes; whoever needs more makes it grow.

    Attributes:
        address: what the other process opens it by.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._map: mmap.mmap | None = None
        self._size = 0

    @staticmethod
    def create() -> SharedArea:
        """A new one; the process that is to open it must be started with `descriptor` passed on."""
        if sys.platform == "win32":
            return SharedArea(f"name:dgs-{uuid.uuid4().hex}")
        if hasattr(os, "memfd_create"):
            return SharedArea(f"file:{os.memfd_create('dgs')}")
        with tempfile.TemporaryFile() as file:
            return SharedArea(f"file:{os.dup(file.fileno())}")

    @property
    def descriptor(self) -> int | None:
        """The open file to pass on to the other process, for `subprocess.Popen(pass_fds=...)`; None on Windows."""
        kind, _, value = self.address.partition(":")
        return int(value) if kind == "file" and value.isdigit() else None

    def view(self, size: int) -> memoryview:
        """Its first `size` bytes, to be read and written.

        Raises:
            DgsError: there is not enough memory, or the other process has not passed it on.
        """
        room = max(_LEAST, 1 << (size - 1).bit_length())
        try:
            if self._map is None or self._size < room:
                self._map, self._size = self._mapped(room), room
        except (OSError, ValueError, OverflowError) as error:
            raise DgsError(
                f"{size / 1e6:.0f} MB cannot be shared with the engine ({error})", "Close other programs"
            ) from error
        return memoryview(self._map)[:size]

    def close(self) -> None:
        """Lets go of it; views that are still held stay valid."""
        descriptor, self._map, self._size = self.descriptor, None, 0
        self.address = ""
        if descriptor is not None:
            os.close(descriptor)

    def _mapped(self, room: int) -> mmap.mmap:
        if sys.platform == "win32":
            return mmap.mmap(-1, room, tagname=f"{self.address}-{room}")
        descriptor = self.descriptor
        if descriptor is None:
            raise ValueError("its address is wrong")
        if os.fstat(descriptor).st_size < room:
            os.ftruncate(descriptor, room)
        return mmap.mmap(descriptor, room)
