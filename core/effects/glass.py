"""Frosted glass before the camera: given, shown by points, or its distance learned (`core.training.optics.glass`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..imaging.formation.glass import FrostedGlass, GlassScene
from ..inspection.evidence import Evidence, judged, shortened, unknown
from ..numbers import NOT_CHECKED, number
from .spec import EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from ..inspection.glass_by_points import GlassPlane, GlassShown
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class GlassEffectSettings:
    """Numbers of the evidence for frosted glass."""

    smallest_visible: float = number(
        0.7,
        "px",
        "standard deviation that differs between depths",
        "two sets behind Cycles' glass that leans, and that stands: 1.5 and 1.2 px, found with 0.7, not with 1",
        "none of 133 and 36 drawn sets, and of 8 real ones without a glass, is taken for one",
    )
    off: float = number(
        0.2,
        "share",
        "of what differs, that it is off by whatever the number of points",
        "widths of edges on four sets behind Cycles' glass: -7 to +14 %; distances -15 to +6 %",
        NOT_CHECKED,
    )


SETTINGS = GlassEffectSettings()


def _shown(photos: PhotoSet) -> GlassShown | None:
    from ..inspection.glass_planes import glass_of  # heavy: scipy

    return photos.once(glass_of)


def inspect(photos: PhotoSet) -> Evidence:
    """Whether the same points are blurrier the farther away they are, alike in all photos."""
    smallest = SETTINGS.smallest_visible
    if photos.observations is None:
        return unknown(FrostedGlass.name, "px", smallest, f"Not measured: {photos.no_observations}")
    seen = _shown(photos)
    if seen is None:
        return unknown(FrostedGlass.name, "px", smallest, "Not measured: too few points stand clear of the noise")
    details = {
        "width": shortened(seen.width),
        # (the error of a width that edges show is that of thin lines among them, which nothing here measures)
        **({} if seen.given else {"width_error": shortened(seen.width_error)}),
        "distance": shortened(seen.distance),
        "distance_error": shortened(seen.distance_error),
    }
    text = (
        f"The same points in different photos: {seen.grows:.2f} px (sigma) more blur at a depth of {seen.farthest:.3g} "
        f"than at {seen.nearest:.3g}, alike in all photos; {seen.width:.1f}"
        + (" px in between, as edges show" if seen.given else f" +- {seen.width_error:.1f} px in between")
        + ("" if seen.plane is None else f"; {_words(seen.plane)}")
    )
    if seen.better_than_even:
        error = math.hypot(seen.grows_error, SETTINGS.off * seen.grows)
        found = judged(FrostedGlass.name, seen.grows, error, smallest, "px", text, **details)
        if found.needed:
            return found
    why = (
        "what is sharp lies among what they show" if seen.inside else "one blur for all depths explains nearly as much"
    )
    text = f"{text}; but {why}: give --psf or --glass (measure-psf, measure-glass) if there is a glass"
    return judged(FrostedGlass.name, 0.0, seen.grows_error, smallest, "px", text, **details)


def _words(plane: GlassPlane) -> str:
    """How the sheet leans, and whether it stands in the world."""
    right, down = (math.degrees(math.atan(lean)) for lean in plane.lean)
    what = "the glass stands in the world and leans" if plane.standing else "the glass leans"
    return f"{what} by {right:.0f} and {down:.0f} degrees (right, down)"


def build(photos: PhotoSet) -> FrostedGlass | None:
    """The glass that points show, as narrow as their errors allow; where they show none, one at the camera of no width.

    None without cameras.
    """
    if photos.cameras is None:
        return None
    lenses = [photos.cameras.lenses[name] for name in sorted(photos.cameras.poses)]
    diagonals = [math.hypot(lens.width, lens.height) for lens in lenses]
    focal = sum(math.sqrt(lens.fx * lens.fy) / d for lens, d in zip(lenses, diagonals, strict=True)) / len(lenses)
    seen = _shown(photos)
    if seen is None or not seen.better_than_even:
        return FrostedGlass.of(0.0, 0.0, GlassScene(focal))
    diagonal = math.hypot(*photos.greys[0].shape)
    scene = GlassScene(focal, diagonal, seen.nearest, seen.farthest)
    plane = seen.plane
    if plane is None:
        far = seen.safe_width / (1.0 - seen.distance / seen.middle) / diagonal
        sheet = FrostedGlass.of(far, seen.distance, scene)
        sheet.errors = 0.0, seen.distance_error
        return sheet
    far = plane.far * (seen.safe_width / seen.width) / diagonal
    scene = replace(scene, stands=plane.stands)
    sheet = FrostedGlass.of(far, plane.distance, scene, tilt=plane.lean)
    sheet.errors, sheet.tilt_errors = (0.0, plane.distance_error), plane.lean_error
    return sheet


SPEC = EffectSpec(
    name="glass",
    physics=FrostedGlass.physics,
    words=EffectWords(
        label="Frosted Glass",
        tooltip="A sheet of rough glass before the camera: what is farther behind it is blurred more",
        simulated="Frosted glass before the camera: blur that grows with the depth behind it, and what it hides.",
    ),
    inspect=inspect,
    switch=Switch(
        speakers=("glass",),
        trial_rank=8,
        simulation=FrostedGlass,
        build=build,
        confirmed_by="evidence",
        by_name_only=True,
    ),
)
