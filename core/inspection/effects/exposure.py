"""Exposure: how the photos' brightness differs where they show the same points."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet

#: Standard deviation of the natural log of the gain that a twin begins to show (flicker between views).
SMALLEST = 0.03


def inspect(photos: PhotoSet) -> Evidence:
    """Spread of the photos' common gain."""
    fit = photos.photometry
    if fit is None:
        return unknown("exposure", "relative", SMALLEST, f"Not measured: {photos.no_tracks}")
    gains, draws = fit.gains.mean(axis=1), fit.gains_draws.mean(axis=2)
    value, error = spread(gains, draws)
    text = (
        f"The same points are {100 * value:.1f} % (rms) brighter or darker from photo to photo, "
        f"{np.ptp(gains) / np.log(2):.2f} stops from the darkest to the brightest photo"
    )
    evidence = judged("exposure", value, error, SMALLEST, "relative", text)
    assert photos.tracks is not None
    names = photos.tracks.names
    evidence.plots.update(gains={n: [float(v) for v in row] for n, row in zip(names, fit.gains, strict=True)})
    return evidence


def spread(values: np.ndarray, draws: np.ndarray) -> tuple[float, float]:
    """Standard deviation of `values` [V, ...] without what noise adds, and its own error.

    Args:
        draws: [D, V, ...] bootstrap draws of `values`.
    """
    noise = float(draws.var(axis=0).mean())
    total = float(values.var())
    value = float(np.sqrt(max(total - noise, 0.0)))
    count = max(2, values.shape[0])
    error = np.sqrt(total / (2 * (count - 1)) + noise / count)
    return value, float(max(error, 0.003))
