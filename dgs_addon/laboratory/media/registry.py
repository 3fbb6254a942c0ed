"""All media that Cycles renders: a file each, and a line here."""

from __future__ import annotations

from ....core.errors import DgsError
from . import defocus, fog, frosted_glass, shake, standing_glass
from .medium import Medium, MediumSpec

MEDIA: tuple[MediumSpec, ...] = (shake.SPEC, defocus.SPEC, frosted_glass.SPEC, standing_glass.SPEC, fog.SPEC)


def medium_of(text: str) -> Medium:
    """The medium that 'NAME:VALUES' says.

    Raises:
        DgsError: there is none, or its values make no sense.
    """
    name, _, values = text.partition(":")
    for spec in MEDIA:
        if spec.name == name:
            return spec.parse(values)
    raise DgsError(f"There is no medium '{text[:60]}'", f"Write {forms()}")


def forms() -> str:
    """How all media are written."""
    return ", ".join(f"{spec.name}:{spec.form}" for spec in MEDIA)
