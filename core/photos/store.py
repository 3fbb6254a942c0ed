"""Photos on disk instead of in memory: arrays that are mapped from files, so that a set may be larger than the memory.

`PhotoStore.kept` writes an array and gives it back as a view of the file; whoever computes with it notices nothing.
What is made of such a photo (undistorted, averaged, rendered for comparison) is put beside it by `kept_beside`. Values
are the same to the bit.

The files have no name: the system frees them when the process ends, however it ends. Pages that were read count as this
process's memory until they are given back; a thread does that whenever the process comes near its limit, and they are
read again when they are needed. Where the system does not say how much memory a process holds (not Linux), it takes
such pages back by itself when others need them.
"""

from __future__ import annotations

import mmap
import tempfile
import threading
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..files import output_error
from ..numbers import BY_DEFINITION, number

A = TypeVar("A", bound=NDArray[Any])


@dataclass(frozen=True)
class StoreSettings:
    """Numbers of the store."""

    segment: int = number(2**28, "bytes", "of a file at least: a file is open for each, and systems allow 1024")
    alignment: int = number(64, "bytes", "where arrays begin: a line of the cache", BY_DEFINITION)
    full: float = number(
        0.75, "share of the limit", "at which pages are given back: what is computed meanwhile has the rest"
    )
    every: float = number(0.02, "s", "between two looks; a core reads some 100 MB from the disk's cache in it")


SETTINGS = StoreSettings()


class Segment(mmap.mmap):
    """A piece of a store's file, mapped; arrays in it keep it alive."""

    store: PhotoStore


class PhotoStore:
    """Arrays in nameless files.

    Args:
        folder: on the disk that is to hold them; made if missing.
        limit: bytes that this process should hold at most; pages are given back before. None: the system decides.

    Attributes:
        bytes: written so far.
    """

    def __init__(self, folder: Path, limit: int | None = None, settings: StoreSettings = SETTINGS) -> None:
        self.folder, self.limit, self.settings = folder, limit, settings
        self.bytes = 0
        self._lock = threading.Lock()
        self._segments: weakref.WeakSet[Segment] = weakref.WeakSet()
        self._current: Segment | None = None
        self._end = 0
        self._file: Any = None
        if limit is not None and held_bytes() is not None and hasattr(mmap, "MADV_DONTNEED"):
            threading.Thread(target=_watch, args=(weakref.ref(self), settings.every), daemon=True).start()

    def kept(self, array: A) -> A:
        """The same array, on disk; it cannot be written to.

        Raises:
            OutputError: no room, or no permission.
        """
        whole = np.ascontiguousarray(array)
        if not whole.nbytes:
            return array
        with self._lock:
            segment, at = self._placed(whole)
        shown: Any = np.frombuffer(segment, whole.dtype, whole.size, at).reshape(whole.shape)
        return shown

    def _placed(self, whole: NDArray[Any]) -> tuple[Segment, int]:
        """Writes an array; the segment that it is in, and where."""
        try:
            if self._current is None or self._end + whole.nbytes > len(self._current):
                self._begin(max(self.settings.segment, whole.nbytes))
            assert self._current is not None
            at, data = self._end, whole.reshape(-1).view(np.uint8).data
            self._file.seek(at)
            done = 0
            while done < len(data):  # (one call writes 2 GB at most)
                done += self._file.write(data[done:])
        except OSError as error:
            raise output_error(self.folder, error) from error
        step = self.settings.alignment
        self._end = (at + whole.nbytes + step - 1) // step * step
        self.bytes += whole.nbytes
        return self._current, at

    def _begin(self, size: int) -> None:
        """A new segment."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._file = tempfile.TemporaryFile(buffering=0, dir=self.folder)  # noqa: SIM115 (as long as it is written to)
        self._file.truncate(size)
        segment = Segment(self._file.fileno(), size, access=mmap.ACCESS_READ)
        segment.store = self
        self._segments.add(segment)
        self._current, self._end = segment, 0

    def give_back(self) -> None:
        """Lets go of all pages that were read; who needs them reads them again."""
        with self._lock:
            segments = list(self._segments)
        for segment in segments:
            segment.madvise(mmap.MADV_DONTNEED)


def store_of(array: NDArray[Any]) -> PhotoStore | None:
    """The store that holds an array, or a view of one; None for an array in memory."""
    base: Any = array
    while base is not None and not isinstance(base, Segment):
        base = base.obj if isinstance(base, memoryview) else getattr(base, "base", None)
    return None if base is None else base.store


def kept_beside(source: NDArray[Any], array: A) -> A:
    """What was made of a photo, where the photo is: on disk, or in memory (the very same array then).

    Raises:
        OutputError: no room on the disk.
    """
    store = store_of(source)
    return array if store is None or store_of(array) is store else store.kept(array)


def held_bytes() -> int | None:
    """Memory that this process holds now; None where the system does not say."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * mmap.PAGESIZE
    except (OSError, ValueError, IndexError):
        return None


def _watch(store: weakref.ref[PhotoStore], every: float) -> None:
    """Gives pages back whenever the process holds much, as long as the store is there."""
    pause = threading.Event()
    while True:
        here = store()
        if here is None:
            return
        held = held_bytes()
        if held is not None and here.limit is not None and held > here.settings.full * here.limit:
            here.give_back()
        del here
        pause.wait(every)
