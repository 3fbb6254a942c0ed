"""Lens distortion: how far the cameras' lenses move the corners."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet

#: px anywhere in the frame.
SMALLEST = 1.0


def inspect(photos: PhotoSet) -> Evidence:
    """The largest shift that the lens models say."""
    if photos.cameras is None:
        return unknown("lens_distortion", "px", SMALLEST, f"Not measured: {photos.why or 'no cameras'}")
    shifts = [lens.largest_shift() for lens in set(photos.cameras.lenses.values())]
    value = float(np.median(shifts))
    return judged(
        "lens_distortion",
        value,
        max(0.1 * value, 0.2),
        SMALLEST,
        "px",
        f"The lens moves the corners by {value:.1f} px; photos are straightened with the cameras' own lenses",
    )
