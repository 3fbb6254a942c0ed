"""Blurs that vary, confirmed by the photos themselves: are the same points blurrier where the effect says so?

A short training cannot say: its twin is soft, so that any further blur looks wrong, and long ones are dear. One point
in several photos shows the same texture, sharper here and softer there (`inspection.same_points`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ...effects.depth_unit import depth_unit
from ...imaging.formation.spreading import SpreadingEffect
from ...inspection.photo_set import PhotoSet
from ...inspection.same_points import agreement
from ...numbers import number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ConfirmationSettings:
    """Numbers of the confirmation by points."""

    least_share: float = number(
        0.5,
        "share of the effect",
        "that the points must show: what else differs between photos (a scene's own spectrum, the surroundings that a "
        "blur mixes in) showed up to half of an effect that was not there",
        "benchmarks/effects_points.py, drawn scenes",
    )
    sure: float = number(2.0, "standard errors", "by which the share must be larger", "95 % of a normal")


SETTINGS = ConfirmationSettings()


@dataclass(frozen=True)
class Confirmation:
    """What the same points show: the share of the effect, its standard error, and the verdict."""

    share: float
    error: float

    @property
    def confirms(self) -> bool:
        """Whether it is more than chance and more than other causes give."""
        return self.share - SETTINGS.sure * self.error > SETTINGS.least_share


def confirmed_by_points(effect: SpreadingEffect, photos: PhotoSet) -> Confirmation | None:
    """Compares an effect with the photos' points; None where too few are seen."""
    local, unit = photos.local_blur, depth_unit(photos)
    if local is None or unit is None:
        return None
    diagonal = math.hypot(*photos.greys[0].shape)

    def claimed(depth: Array, r2: Array) -> Array:
        with torch.no_grad():
            spread = effect.spread(torch.from_numpy(depth * unit), torch.from_numpy(r2), diagonal)
        return np.asarray(spread.numpy(), np.float64)

    def others(depth: Array, r2: Array) -> Array:
        return r2[:, None] if effect.by_depth else np.column_stack([1.0 / depth, 1.0 / depth**2])

    found = agreement(photos, claimed, local.sharpest, others)
    return None if found is None else Confirmation(found.share, found.error)
