"""Defocus: what is nearer or farther than the plane in focus becomes a spot instead of a point.

A photo's own focus is learned with the twin (`LensFocus`, `core.training.optics.focus`). Where a short trial does not
confirm that, what tiles show of one focus that all photos share is simulated as it is (`Defocus`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.by_depth import occlusion
from ..imaging.formation.effect import Shot
from ..imaging.formation.focus import FOCUS, Focus, LensFocus
from ..imaging.formation.spreading import SpreadingEffect
from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..inspection.focus_by_points import FociOfPoints
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class DefocusSettings:
    """Numbers of defocus."""

    strength_error: float = number(
        0.18,
        "share",
        "standard deviation of the strength that points show of photos with a focus of their own",
        "rendered and drawn lenses: 0 to 18 % too large, 20 % too small on a drawn one",
        "brighton through a lens: 26 % too small",
    )
    reach: float = number(
        0.5, "1 / median depth", "off the focus: most of a scene lies nearer to it, so no light comes from beyond"
    )


SETTINGS = DefocusSettings()


class Defocus(SpreadingEffect):
    """One focus for all photos. The light of a px at depth d spreads with sigma = strength |1 / d - focus|.

    strength: [] as a share of the photo's diagonal, so that it is the same on every grid; focus: [] 1 / depth of the
    plane in focus. Depths in median depths, strength for 1 / depth in that unit. The depth is the sharp render's and
    taken as given: the gradient goes to light, strength and focus. The spot is taken for a Gaussian.
    """

    name = "defocus"
    physics = LensFocus.physics
    by_depth = True

    def __init__(self, strength: Tensor, focus: Tensor) -> None:
        super().__init__({"strength": strength, "focus": focus})

    def spread(self, depth: Tensor, r2: Tensor, diagonal: float) -> Tensor:
        """See `SpreadingEffect`."""
        return (self.parameters["strength"].to(depth) * diagonal * self._off_focus(depth)) ** 2

    def reach(self, diagonal: float) -> float:
        """See `Effect`: that of what lies half a 1 / (median depth) off the focus, as most of a scene does not."""
        return SETTINGS.reach * diagonal * abs(float(self.parameters["strength"].detach()))

    def _off_focus(self, depth: Tensor) -> Tensor:
        return 1.0 / depth.clamp(min=FOCUS.nearest_depth) - self.parameters["focus"].to(depth)

    def add_gradients(self, in_variance: Tensor | None, shot: Shot, light: Tensor) -> None:
        """See `SpreadingEffect`."""
        if in_variance is None:
            for name, value in self.parameters.items():
                self._add(name, value.new_zeros(value.shape))
            return
        off, strength = self._off_focus(self._where(shot, light)[0]), self.parameters["strength"].to(light)
        per = in_variance * off * (2.0 * strength * shot.diagonal**2)
        self._add("strength", (per * off).sum())
        self._add("focus", -(per * strength).sum())

    def described(self) -> dict[str, object]:
        """Strength in thousandths of the diagonal per 1 / median depth, and the depth in focus."""
        strength, focus = (float(self.parameters[name].detach()) for name in ("strength", "focus"))
        return {"strength_per_mille": round(1000 * strength, 4), "focus": round(focus, 5)}


def inspect(photos: PhotoSet) -> Evidence:
    """Blur of tiles against the depth of the points in them; where that shows none, each photo's focus by points."""
    alike, shown = _of_all(photos), None if photos.observations is None else _foci_of(photos)
    if alike.needed or shown is None or not shown.clear:
        return alike
    text = (
        f"Photos have a focus of their own each: half a photo's range of depths off it {shown.width:.2f} px (sigma) are"
        f" added, by the same points in {len(shown.foci)} photos"
    )
    error, smallest = SETTINGS.strength_error * shown.width, alike.estimate["smallest"]
    return judged("defocus", shown.width, error, smallest, "px", text, photos=len(shown.foci))


def _foci_of(photos: PhotoSet) -> FociOfPoints | None:
    """What points show of the photos' foci."""
    from ..inspection.focus_by_points import focus_by_points  # heavy: scipy

    return photos.once(focus_by_points)


def _of_all(photos: PhotoSet) -> Evidence:
    """One focus that all photos share."""
    from ..inspection.local_blur import SETTINGS as LOCAL  # heavy: numpy

    smallest = LOCAL.smallest_defocus
    if photos.observations is None:
        return unknown("defocus", "px", smallest, f"Not measured: {photos.no_observations}")
    local = photos.local_blur
    if local is None or not local.by_depth:
        return unknown("defocus", "px", smallest, "Not measured: the scene is too flat, or too few tiles hold points")
    sharp = local.curve[0][int(local.curve[1].argmin())]
    text = f"{local.defocus:.2f} px (sigma) are added away from the sharpest depth, {sharp:.2f} of the median"
    return judged(
        "defocus", local.defocus, local.defocus_error, smallest, "px", text, sharpest_depth=round(float(sharp), 3)
    )


def build(photos: PhotoSet) -> LensFocus | None:
    """Every photo's focus, learned from where points show it; None without cameras, or where no photo has detail."""
    if photos.cameras is None or not any(blur is not None for blur in photos.blurs):
        return None
    names, shown = sorted(photos.cameras.poses), _foci_of(photos)
    if shown is None or not shown.clear:
        return LensFocus.unknown(names)
    foci = {
        name: Focus(0.0 if name in shown.sharp else shown.strength, focus)
        for name, focus in shown.foci.items()
        if name in photos.cameras.poses
    }
    return LensFocus.begun(names, foci, shown.unit)


def shared_focus(photos: PhotoSet) -> Defocus | None:
    """What the tiles show beyond the blur that they share, which is the medium's."""
    from .depth_unit import depth_unit  # heavy: torch

    local, unit = photos.local_blur, depth_unit(photos)
    if local is None or not local.by_depth or unit is None:
        return None
    diagonal = math.hypot(*photos.greys[0].shape)
    inverse = 1.0 / local.curve[0]
    focus = float(inverse[int(local.curve[1].argmin())])
    strength = local.defocus / float(abs(inverse - focus).max())
    # 1 / depth in the trainer's unit is that of the observations over `unit`.
    return Defocus(*occlusion().scalars(strength * unit / diagonal, focus / unit))


SPEC = EffectSpec(
    name="defocus",
    physics=Defocus.physics,
    words=EffectWords(
        label="Defocus",
        tooltip="A lens that images one distance sharply and blurs what is nearer or farther",
        simulated="Defocus: blur that grows in 1 / depth with the distance from the plane in focus of each photo.",
        missing="Blur that changes with depth",
        blurred="partly out of focus",
    ),
    inspect=inspect,
    switch=Switch(
        speakers=("defocus",),
        trial_rank=5,
        simulation=LensFocus,
        build=build,
        shared=shared_focus,
        unmeasured="too few regions hold detail at depths that differ",
    ),
)
