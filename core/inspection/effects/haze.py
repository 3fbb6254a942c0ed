"""Haze, smoke, water: the farther a point, the less of its own light and the more of the medium's."""

from __future__ import annotations

import math

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..local_blur import fit_local_blur
from ..photo_set import PhotoSet
from ..tracks import WINDOW
from .motion import motion_of

#: Optical depth at the scene's median depth: 8 % of the contrast.
SMALLEST = 0.08


def inspect(photos: PhotoSet) -> Evidence:
    """Attenuation and backscatter from the same points at different distances."""
    fit = photos.photometry
    if fit is None:
        return unknown("haze", "optical depth", SMALLEST, f"Not measured: {photos.no_tracks}")
    value = float(fit.attenuation.mean())
    error = float(fit.attenuation_draws.mean(axis=1).std())
    if error > 0.35:
        return unknown(
            "haze", "optical depth", SMALLEST, "Not measured: no point is seen from distances different enough"
        )
    local = fit_local_blur(photos)
    if local is not None and local.defocus_significant:
        # Blur that grows with depth mixes a point with its surroundings, as haze does.
        error = float(np.hypot(error, 0.5 * local.defocus**2 / WINDOW**2))
    # So does blur that differs from photo to photo; what motion adds, the colours were compared without.
    window = max(WINDOW, 1.3 * photos.sigma)
    error = float(np.hypot(error, 0.5 * _differing(photos) / window**2))
    veil = fit.backscatter / np.maximum(fit.attenuation, 1e-6)
    text = (
        f"Points keep {100 * np.exp(-max(value, 0)):.0f} % of their contrast at the median distance "
        f"(optical depth {value:.2f} +- {error:.2f})"
    )
    details = {
        "attenuation": [round(float(v), 4) for v in fit.attenuation],
        "backscatter": [round(float(v), 4) for v in fit.backscatter],
        "veil": [round(float(np.clip(v, 0, 1)), 4) for v in veil],
    }
    return judged("haze", value, float(np.hypot(error, 0.02)), SMALLEST, "optical depth", text, **details)


def _differing(photos: PhotoSet) -> float:
    """Standard deviation (px^2) of the photos' variances beyond noise; 0 where motion is what differs."""
    moved = motion_of(photos)
    known = [blur for blur in photos.blurs if blur is not None]
    if len(known) < 4 or (moved is not None and moved.significant):
        return 0.0
    own = np.array([blur.variance for blur in known])
    noise = float(np.mean([blur.variance_error**2 for blur in known]))
    return math.sqrt(max(float(own.var()) - noise, 0.0))
