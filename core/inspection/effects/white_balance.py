"""White balance: how the photos' colour differs where they show the same points."""

from __future__ import annotations

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet
from .exposure import spread

#: Standard deviation of the natural log of one channel's gain against the others'.
SMALLEST = 0.02


def inspect(photos: PhotoSet) -> Evidence:
    """Spread of the channels' gains around each photo's common gain."""
    fit = photos.photometry
    if fit is None:
        return unknown("white_balance", "relative", SMALLEST, f"Not measured: {photos.no_tracks}")
    tint = fit.gains - fit.gains.mean(axis=1, keepdims=True)
    draws = fit.gains_draws - fit.gains_draws.mean(axis=2, keepdims=True)
    value, error = spread(tint, draws)
    return judged(
        "white_balance",
        value,
        error,
        SMALLEST,
        "relative",
        f"The channels of the same points differ by {100 * value:.1f} % (rms) from photo to photo",
    )
