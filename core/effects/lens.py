"""Lens distortion: how far the cameras' lenses move the corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class LensSettings:
    """Numbers of the evidence for lens distortion."""

    smallest_visible: float = number(1.0, "px", "shift anywhere in the frame", SMALLEST_CHOSEN, SMALLEST_CHECKED)
    error_share: float = number(0.1, "share", "of the shift: its error, as lens models of one set scatter")
    least_error: float = number(0.2, "px", "of the shift")


SETTINGS = LensSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """The largest shift that the lens models say."""
    import numpy as np  # late: the command line's help reads this file

    smallest = SETTINGS.smallest_visible
    if photos.cameras is None:
        return unknown("lens_distortion", "px", smallest, f"Not measured: {photos.why or 'no cameras'}")
    shifts = [lens.largest_shift() for lens in set(photos.cameras.lenses.values())]
    value = float(np.median(shifts))
    return judged(
        "lens_distortion",
        value,
        max(SETTINGS.error_share * value, SETTINGS.least_error),
        smallest,
        "px",
        f"The lens moves the corners by {value:.1f} px; photos are straightened with the cameras' own lenses",
    )


SPEC = EffectSpec(
    name="lens_distortion",
    physics="A lens that is no pinhole bends straight lines, most in the corners.",
    words=EffectWords(label="Lens Distortion"),
    inspect=inspect,
)
