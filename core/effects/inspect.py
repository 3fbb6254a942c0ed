"""The whole inspection: every effect's evidence, timed."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace

from ..errors import Cancelled
from ..inspection.evidence import Evidence
from ..inspection.photo_set import PhotoSet
from ..progress import Progress
from .registry import all_effects


def inspect_photos(photos: PhotoSet, progress: Progress, only: Iterable[str] | None = None) -> list[Evidence]:
    """Evidence of every effect, in the registry's order.

    The first effect that needs points, spectra or tiles pays for them; its seconds say so.

    Raises:
        Cancelled: the user asked to stop.
    """
    wanted = None if only is None else set(only)
    specs = [spec for spec in all_effects() if wanted is None or spec.name in wanted]
    progress.stage("inspect", len(specs))
    found = []
    for index, spec in enumerate(specs):
        if progress.cancelled():
            raise Cancelled("Stopped while inspecting the photos")
        began = time.perf_counter()
        evidence = spec.inspect(photos)
        found.append(replace(evidence, seconds=time.perf_counter() - began))
        progress.advance(index + 1)
    return found
