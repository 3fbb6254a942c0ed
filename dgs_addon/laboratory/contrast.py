"""A camera's own contrast, as it is asked for. Loads nothing heavy, as the command line's help reads the settings."""

from __future__ import annotations

import math

from ...core.errors import DgsError

_CURVES = "Write s:POWER or film:STRENGTH, such as s:1.4 or film:1"
#: Of a camera's own contrast: a power of 4, and a strength of 4, leave a photo of black, white and little between.
_STEEPEST = 4.0


def curve_of(contrast: str) -> tuple[str, float]:
    """Kind and strength of a camera's own curve.

    Raises:
        DgsError: the text makes no sense.
    """
    kind, _, strength = contrast.partition(":")
    try:
        value = float(strength)
    except ValueError:
        value = math.nan
    least = 1 / _STEEPEST if kind == "s" else -_STEEPEST
    if kind not in ("s", "film") or not least <= value <= _STEEPEST or (kind == "film" and value == 0):
        raise DgsError(f"The contrast '{contrast[:60]}' makes no sense", _CURVES)
    return kind, value
