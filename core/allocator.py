"""What the C library does with memory that a step has freed.

A step of the training takes and frees tens of megabytes. By itself glibc hands freed memory at the end of its heap back
to the system and fetches it anew, zeroed page by page: up to 2,600 pages in every second step, 4 to 8 ms of the
system's time (20,000 Gaussians at 800 x 533 px). Kept, nothing is fetched after the first steps.
"""

from __future__ import annotations

import ctypes
import sys
from dataclasses import dataclass

from .numbers import number


@dataclass(frozen=True)
class AllocatorSettings:
    """What the C library keeps."""

    kept: int = number(
        256 * 2**20,
        "bytes",
        "at the heap's end that stay: four times what lies free in it between steps, so that no step fetches any",
        "800 x 533 px, 100,000 Gaussians: 65 MB free; the only value that was tried",
    )
    mapped: int = number(32 * 2**20, "bytes", "from which on memory is mapped, and goes back: the most glibc takes")


ALLOCATOR = AllocatorSettings()
#: Of `mallopt`, in glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


def keep_freed_memory() -> bool:
    """Has this process keep what it frees for what it needs next; whether the C library can (glibc)."""
    if not sys.platform.startswith("linux"):
        return False
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallopt") or not hasattr(library, "gnu_get_libc_version"):
        return False  # musl frees in ways of its own
    return bool(library.mallopt(_MMAP_THRESHOLD, ALLOCATOR.mapped) and library.mallopt(_TRIM_THRESHOLD, ALLOCATOR.kept))
