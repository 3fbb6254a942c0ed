"""A rolling shutter as text: what `--rolling-shutter` takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import DgsError

#: Exposures from the first row to the last one; beyond, more frames than anybody waits for lie along a path.
LONGEST_READOUT = 20.0


@dataclass(frozen=True)
class ShutterRequest:
    """What the user says of the shutter.

    Attributes:
        readout: time from the first row's exposure to the last row's, in exposures; below 0 the last row is read
            first; None to find it in the photos.
    """

    readout: float | None = None


def parse_shutter(text: str) -> ShutterRequest:
    """Reads `auto` or READOUT.

    Raises:
        DgsError: the text makes no sense; it says why.
    """
    if text.strip() == "auto":
        return ShutterRequest()
    try:
        readout = float(text)
    except ValueError:
        readout = math.nan
    if not abs(readout) <= LONGEST_READOUT:
        raise DgsError(
            f"The rolling shutter '{text[:40]}' is none",
            "Write --rolling-shutter auto, or the exposures from the first row to the last one, "
            f"{-LONGEST_READOUT:g} to {LONGEST_READOUT:g}",
        )
    return ShutterRequest(readout)
