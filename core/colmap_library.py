"""pycolmap, without the signal handler that it puts in the place of the program's own.

    from ..colmap_library import pycolmap

Its log library ends the process at SIGTERM with a page of addresses; who asks a run to stop wants it saved.
"""

from __future__ import annotations

import contextlib
import signal

_before = signal.getsignal(signal.SIGTERM)

import pycolmap  # noqa: E402  (what stood before must have been read)

if _before is not None:
    with contextlib.suppress(ValueError):  # only the main thread may set handlers
        signal.signal(signal.SIGTERM, _before)

__all__ = ["pycolmap"]
