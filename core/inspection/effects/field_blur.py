"""Blur that changes over the frame, as the optics' aberrations make it."""

from __future__ import annotations

import math

from ..evidence import Evidence, judged, unknown
from ..local_blur import fit_local_blur
from ..photo_set import PhotoSet

#: Standard deviation (px) that the corners have beyond the middle.
SMALLEST = 1.0


def inspect(photos: PhotoSet) -> Evidence:
    """Blur of tiles against their distance from the photo's middle."""
    local = fit_local_blur(photos)
    if local is None:
        return unknown("field_blur", "px", SMALLEST, "Not measured: too few tiles hold enough detail")
    value = math.sqrt(abs(local.corner))
    error = max(local.corner_error / max(2 * value, 1.0), 0.1)
    where = "corners are blurrier than the middle" if local.corner > 0 else "middle is blurrier than the corners"
    return judged("field_blur", value, error, SMALLEST, "px", f"The {where} by {value:.2f} px (sigma)")
