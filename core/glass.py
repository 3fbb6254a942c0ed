"""Frosted glass as text: what `--glass` takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import PsfError

#: Degrees; beyond, light is turned by more than a small angle, and nothing is left of a photo.
WIDEST_ANGLE = 15.0


@dataclass(frozen=True)
class GlassRequest:
    """What the user says of a sheet of frosted glass before the camera.

    Attributes:
        distance: depth of the glass in the cameras' unit, None to learn it.
        angle: standard deviation in rad of the angle by which light is turned; None where `--psf` says how wide it
            blurs at the scene's middle depth.
    """

    distance: float | None = None
    angle: float | None = None


def parse_glass(text: str) -> GlassRequest:
    """Reads `auto` or `DISTANCE[,ANGLE]` (the cameras' unit, degrees).

    Raises:
        PsfError: the text makes no sense; it says why.
    """
    if text.strip() == "auto":
        return GlassRequest()
    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2) or not all(map(math.isfinite, values)):
        raise PsfError(
            f"The glass '{text}' is none", "Write --glass auto or DISTANCE[,ANGLE] (the cameras' unit, degrees)"
        )
    if values[0] <= 0:
        raise PsfError(
            f"A glass at {values[0]:g} is not before the camera",
            "Give a distance above 0, or leave --glass out: --psf alone is a glass close to the camera",
        )
    if len(values) == 2 and not 0 < values[1] <= WIDEST_ANGLE:
        raise PsfError(
            f"Frosted glass cannot scatter by {values[1]:g} degrees", f"Give an angle above 0, up to {WIDEST_ANGLE:g}"
        )
    return GlassRequest(values[0], math.radians(values[1]) if len(values) == 2 else None)
