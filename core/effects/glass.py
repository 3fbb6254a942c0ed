"""Frosted glass before the camera: its distance is given, or learned with the twin (`core.training.glass`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.glass import FrostedGlass, GlassScene
from ..inspection.evidence import Evidence, unknown
from ..numbers import number
from .spec import SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class GlassEffectSettings:
    """Numbers of the evidence for frosted glass."""

    smallest_visible: float = number(1.0, "px", "standard deviation that differs between depths", SMALLEST_CHOSEN)


SETTINGS = GlassEffectSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """Where all photos are taken through it, nothing shows how sharp the scene is."""
    smallest = SETTINGS.smallest_visible
    return unknown("glass", "px", smallest, "Not measured: photos without the glass would be needed beside these")


def build(photos: PhotoSet) -> FrostedGlass | None:
    """The glass at the camera itself, which is one point spread, of no width yet; None without cameras."""
    if photos.cameras is None:
        return None
    lenses = [photos.cameras.lenses[name] for name in sorted(photos.cameras.poses)]
    focal = sum(math.sqrt(lens.fx * lens.fy) / math.hypot(lens.width, lens.height) for lens in lenses) / len(lenses)
    return FrostedGlass.of(0.0, 0.0, GlassScene(focal))


SPEC = EffectSpec(
    name="glass",
    physics=FrostedGlass.physics,
    words=EffectWords(
        label="Frosted Glass",
        tooltip="A sheet of rough glass before the camera: what is farther behind it is blurred more",
        simulated="Frosted glass before the camera: blur that grows with the depth behind it, and what it hides.",
    ),
    inspect=inspect,
    switch=Switch(speakers=("glass",), trial_rank=8, simulation=FrostedGlass, build=build, by_name_only=True),
)
