"""Vignetting: the same point darkens towards the photo's corners."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet

#: Share of the light lost in the corner.
SMALLEST = 0.08


def inspect(photos: PhotoSet) -> Evidence:
    """Loss in the corners, relative to the middle."""
    fit = photos.photometry
    if fit is None:
        return unknown("vignetting", "share", SMALLEST, f"Not measured: {photos.no_tracks}")
    value, error = float(fit.vignette.mean()), float(fit.vignette_draws.mean(axis=1).std())
    if error > 0.3:
        return unknown("vignetting", "share", SMALLEST, "Not measured: no point moves far enough over the frame")
    text = f"A point that moves from the middle to a corner loses {100 * value:.1f} +- {100 * error:.1f} % of its light"
    return judged("vignetting", value, float(np.hypot(error, 0.01)), SMALLEST, "share", text)
