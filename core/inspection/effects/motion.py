"""Motion: a blur along one direction that differs from photo to photo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet

#: Length of the camera's path on the photo while the shutter is open, px.
SMALLEST = 3.0


@dataclass(frozen=True)
class Motion:
    """Length of the photos' own paths: rms over the photos, px, with its standard deviation."""

    length: float
    error: float
    photos: dict[str, float]

    @property
    def significant(self) -> bool:
        """Whether it is larger than the smallest visible."""
        return judged("motion", self.length, self.error, SMALLEST, "px", "").needed


#: Highest frequencies (cycles/px) that paths are sought in: that of a path of length L has its first zero at 1 / L, and
#: is no Gaussian's from half of that on.
BANDS = (0.5, 0.25, 0.14, 0.08)


def motion_of(photos: PhotoSet) -> Motion | None:
    """How far the photos' blurs differ from their common one along one direction; None with fewer than four photos.

    Of several bands the one that tells most clearly is taken. Kept with the photos.
    """
    kept = photos.__dict__
    if "_motion" not in kept:
        found = [motion for band in BANDS if (motion := _motion(photos, band)) is not None]
        kept["_motion"] = max(found, key=lambda m: (m.length - SMALLEST) / m.error, default=None)
    chosen: Motion | None = kept["_motion"]
    return chosen


def _motion(photos: PhotoSet, band: float) -> Motion | None:
    blurs = photos.blurs_between(0.0, band)
    known = [(photo.name, b) for photo, b in zip(photos.looked_at, blurs, strict=True) if b is not None]
    if len(known) < 4:
        return None
    # A straight path of length L adds the variance L^2 / 12 along itself: as a spin-2 vector, half of it.
    spin = np.array([[(b.covariance[0] - b.covariance[1]) / 2, b.covariance[2]] for _, b in known])
    common = np.median(spin, axis=0)
    off = spin - common
    j = np.array([[0.5, -0.5, 0.0], [0.0, 0.0, 1.0]])
    noise = np.array([np.trace(j @ b.uncertainty @ j.T) for _, b in known])
    size = np.square(off).sum(axis=1)
    mean = float(size.mean() - noise.mean())
    deviation = float(np.hypot(size.std(ddof=1), noise.mean()) / math.sqrt(len(size)))
    # Half the variance along the path: |off| = L^2 / 24.
    length = math.sqrt(24.0 * math.sqrt(max(mean, 0.0)))
    larger = math.sqrt(24.0 * math.sqrt(max(mean + deviation, 0.0)))
    smaller = math.sqrt(24.0 * math.sqrt(max(mean - deviation, 0.0)))
    error = max((larger - smaller) / 2, 0.15)
    each = {name: math.sqrt(24.0 * math.hypot(*o)) for (name, _), o in zip(known, off, strict=True)}
    return Motion(length, error, each)


def inspect(photos: PhotoSet) -> Evidence:
    """The camera's own movement during the exposures."""
    moved = motion_of(photos)
    if moved is None:
        return unknown("motion", "px", SMALLEST, "Not measured: four photos with detail are needed")
    worst = max(moved.photos, key=lambda name: moved.photos[name])
    longest = f"the longest {moved.photos[worst]:.1f} px in {worst}"
    text = f"Paths of {moved.length:.1f} px (rms) of the photos' own, {longest}"
    evidence = judged("motion", moved.length, moved.error, SMALLEST, "px", text)
    evidence.plots.update(lengths=moved.photos)
    return evidence
