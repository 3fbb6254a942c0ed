"""Blur that all photos share: the narrowest that spectra show anywhere, in any direction."""

from __future__ import annotations

import math

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..local_blur import fit_local_blur
from ..photo_set import PhotoSet
from .motion import motion_of

#: Standard deviation in px: sharp photos of good cameras have 0.3 to 0.8.
SMALLEST = 1.1


def inspect(photos: PhotoSet) -> Evidence:
    """Width of the blur, its direction, and every photo's own."""
    known = [(photo.name, blur) for photo, blur in zip(photos.looked_at, photos.blurs, strict=True) if blur is not None]
    if not known:
        return unknown("blur", "px", SMALLEST, "Not measured: too little detail stands clear of the noise")
    covariances = np.stack([blur.covariance for _, blur in known])
    middle = np.median(covariances, axis=0)
    variances = np.array([blur.variance for _, blur in known])
    # What motion and defocus add is theirs: the shared blur is what is left where they are least.
    shared = float(np.median(variances))
    moved = motion_of(photos)
    if moved is not None and moved.significant:
        shared = float(np.median([_smaller(c) for c in covariances]))
        middle = np.array([shared, shared, 0.0])
    local = fit_local_blur(photos)
    if local is not None and local.defocus_significant:
        shared = min(shared, local.sharpest)
        middle = middle * max(shared, 0.0) / max(float(middle[:2].mean()), 1e-9)
    scatter = 1.4826 * float(np.median(np.abs(variances - np.median(variances)))) / math.sqrt(len(variances))
    value = math.sqrt(max(shared, 0.0))
    # Scenes differ from the power law: 6 % in five scenes, and 0.1 px^2 near zero.
    error = math.hypot(scatter / (2 * max(value, 0.5)), 0.06 * value + 0.05)
    sx, sy, angle = _axes(middle)
    round_ = sx < 1.15 * sy
    shape = "alike in all directions" if round_ else f"{sx:.1f} x {sy:.1f} px, the longer axis at {angle:.0f} degrees"
    text = f"Spectra fall as under a blur of {value:.2f} px (sigma), {shape}"
    evidence = judged(
        "blur", value, error, SMALLEST, "px", text, sigma_x=round(sx, 3), sigma_y=round(sy, 3), angle=round(angle, 1)
    )
    sigmas = {name: math.sqrt(max(blur.variance, 0.0)) for name, blur in known}
    evidence.plots.update(sigmas=sigmas)
    return evidence


def _axes(covariance: np.ndarray) -> tuple[float, float, float]:
    """Standard deviations (larger first) and the larger one's direction, degrees from x towards y."""
    xx, yy, xy = covariance
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    small, large = (math.sqrt(max(v, 0.0)) for v in values)
    return large, small, math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0


def _smaller(covariance: np.ndarray) -> float:
    xx, yy, xy = covariance
    return float((xx + yy) / 2 - math.hypot((xx - yy) / 2, xy))
