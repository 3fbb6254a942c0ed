"""Frosted glass as text: what `--glass` takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import PsfError

#: Degrees; beyond, light is turned by more than a small angle, and nothing is left of a photo.
WIDEST_ANGLE = 15.0
#: Degrees by which a glass may lean; steeper ones are met by rays that run along them.
STEEPEST_TILT = 60.0


@dataclass(frozen=True)
class GlassRequest:
    """What the user says of a sheet of frosted glass before the camera.

    Attributes:
        distance: depth of the glass in the cameras' unit, None to learn it.
        angle: standard deviation in rad of the angle by which light is turned; None where `--psf` says how wide it
            blurs at the scene's middle depth.
        tilt: rad by which its normal leans towards the right and downwards, seen from the camera; None for a glass that
            faces the camera.
        tilted: whether it may lean, by angles that are to be learned.
        standing: whether it stands in the world, instead of moving with the camera; distance and tilt are then those
            before the camera in the middle of all (`core.pipeline.glass.middle_camera`).
    """

    distance: float | None = None
    angle: float | None = None
    tilt: tuple[float, float] | None = None
    tilted: bool = False
    standing: bool = False


def parse_glass(text: str) -> GlassRequest:
    """Reads `auto`, `tilted`, `standing` or `[standing,]DISTANCE[,ANGLE[,RIGHT,DOWN]]` (the cameras' unit, degrees).

    Raises:
        PsfError: the text makes no sense; it says why.
    """
    word = text.strip()
    if word in ("auto", "tilted", "standing"):
        return GlassRequest(tilted=word != "auto", standing=word == "standing")
    first, comma, rest = word.partition(",")
    standing = bool(comma) and first == "standing"
    values = _numbers(text, rest if standing else word)
    _check(values)
    angle = math.radians(values[1]) if len(values) > 1 else None
    tilt = (math.radians(values[2]), math.radians(values[3])) if len(values) > 2 else None
    return GlassRequest(values[0], angle, tilt, standing=standing)


def _numbers(text: str, numbers: str) -> list[float]:
    """One, two or four finite numbers between commas; text: the whole, for the message."""
    try:
        values = [float(value) for value in numbers.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2, 4) or not all(map(math.isfinite, values)):
        raise PsfError(
            f"The glass '{text}' is none",
            "Write --glass auto, tilted, standing or [standing,]DISTANCE[,ANGLE[,RIGHT,DOWN]] (the cameras' unit, "
            "degrees)",
        )
    return values


def _check(values: list[float]) -> None:
    """Raises PsfError where no glass is at that distance, or has that angle or tilt."""
    if values[0] <= 0:
        raise PsfError(
            f"A glass at {values[0]:g} is not before the camera",
            "Give a distance above 0, or leave --glass out: --psf alone is a glass close to the camera",
        )
    if len(values) > 1 and not 0 < values[1] <= WIDEST_ANGLE:
        raise PsfError(
            f"Frosted glass cannot scatter by {values[1]:g} degrees", f"Give an angle above 0, up to {WIDEST_ANGLE:g}"
        )
    steepest = max(map(abs, values[2:]), default=0.0)
    if steepest > STEEPEST_TILT:
        raise PsfError(
            f"A glass that leans by {steepest:g} degrees is seen from its edge", f"Give a tilt up to {STEEPEST_TILT:g}"
        )
