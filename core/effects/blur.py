"""Blur that all photos share: the narrowest that spectra show anywhere, in any direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords

if TYPE_CHECKING:
    import numpy as np

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class BlurSettings:
    """Numbers of the evidence for the blur that all photos share."""

    smallest_visible: float = number(
        1.1, "px", "standard deviation; sharp photos of good cameras have 0.3 to 0.8", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    law_share: float = number(
        0.06, "share", "of the width: how far scenes' spectra differ from the power law", "five drawn scenes"
    )
    least_error: float = number(0.05, "px", "of the width: scenes differ by 0.1 px^2 near zero", "five drawn scenes")
    round_ratio: float = number(1.15, "ratio", "of the two widths up to which the blur is called round")


SETTINGS = BlurSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """Width of the blur, its direction, and every photo's own."""
    import numpy as np  # late: the command line's help reads this file

    smallest = SETTINGS.smallest_visible
    measured = [
        (photo.name, blur) for photo, blur in zip(photos.looked_at, photos.blurs, strict=True) if blur is not None
    ]
    if not measured:
        return unknown("blur", "px", smallest, "Not measured: too little detail stands clear of the noise")
    covariances = np.stack([blur.covariance for _, blur in measured])
    middle = np.median(covariances, axis=0)
    variances = np.array([blur.variance for _, blur in measured])
    # What motion and defocus add is theirs: the shared blur is what is left where they are least.
    shared = float(np.median(variances))
    moved = photos.motion
    if moved is not None and moved.significant:
        shared = float(np.median([_smaller(c) for c in covariances]))
        middle = np.array([shared, shared, 0.0])
    local = photos.local_blur
    if local is not None and local.defocus_significant:
        shared = min(shared, local.sharpest)
        middle = middle * max(shared, 0.0) / max(float(middle[:2].mean()), 1e-9)
    scatter = 1.4826 * float(np.median(np.abs(variances - np.median(variances)))) / math.sqrt(len(variances))
    value = math.sqrt(max(shared, 0.0))
    # Scenes differ from the power law: 6 % in five scenes, and 0.1 px^2 near zero.
    error = math.hypot(scatter / (2 * max(value, 0.5)), SETTINGS.law_share * value + SETTINGS.least_error)
    sx, sy, angle = _axes(middle)
    round_ = sx < SETTINGS.round_ratio * sy
    shape = "alike in all directions" if round_ else f"{sx:.1f} x {sy:.1f} px, the longer axis at {angle:.0f} degrees"
    text = f"Spectra fall as under a blur of {value:.2f} px (sigma), {shape}"
    evidence = judged(
        "blur", value, error, smallest, "px", text, sigma_x=round(sx, 3), sigma_y=round(sy, 3), angle=round(angle, 1)
    )
    sigmas = {name: math.sqrt(max(blur.variance, 0.0)) for name, blur in measured}
    evidence.plots.update(sigmas=sigmas)
    return evidence


def _axes(covariance: np.ndarray) -> tuple[float, float, float]:
    """Standard deviations (larger first) and the larger one's direction, degrees from x towards y."""
    import numpy as np  # late: the command line's help reads this file

    xx, yy, xy = covariance
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    small, large = (math.sqrt(max(v, 0.0)) for v in values)
    return large, small, math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0


def _smaller(covariance: np.ndarray) -> float:
    xx, yy, xy = covariance
    return float((xx + yy) / 2 - math.hypot((xx - yy) / 2, xy))


SPEC = EffectSpec(
    name="blur",
    physics="The medium scatters the light of each point over its surroundings, alike in all photos.",
    words=EffectWords(label="Blur"),
    inspect=inspect,
)
