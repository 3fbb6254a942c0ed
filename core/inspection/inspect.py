"""The whole inspection: every effect's evidence, timed."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace

from ..errors import Cancelled
from ..progress import Progress
from .evidence import Evidence
from .photo_set import PhotoSet
from .registry import INSPECTIONS


def inspect_photos(photos: PhotoSet, progress: Progress, only: Iterable[str] | None = None) -> list[Evidence]:
    """Evidence of every effect, in the registry's order.

    The first effect that needs tracks, spectra or tiles pays for them; its seconds say so.

    Raises:
        Cancelled: the user asked to stop.
    """
    names = [name for name in INSPECTIONS if only is None or name in set(only)]
    progress.stage("inspect", len(names))
    found = []
    for index, name in enumerate(names):
        if progress.cancelled():
            raise Cancelled("Stopped while inspecting the photos")
        began = time.perf_counter()
        evidence = INSPECTIONS[name](photos)
        found.append(replace(evidence, seconds=time.perf_counter() - began))
        progress.advance(index + 1)
    return found
