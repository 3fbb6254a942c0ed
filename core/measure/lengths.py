"""Lengths as text: '12.5mm', '12.5+-0.1mm', '12.5mm+-0.1mm'."""

from __future__ import annotations

import re
from collections.abc import Mapping

_LENGTH = re.compile(
    r"(?P<value>[0-9.eE]+)(?:\s*(?P<first>[^\W\d_]*)\s*\+-\s*(?P<deviation>[0-9.eE]+))?\s*(?P<unit>[^\W\d_]+)"
)
#: Units whose size is known, in mm: what is printed needs one of them. A scale takes any name.
MILLIMETRES: Mapping[str, float] = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "µm": 1e-3,
    "um": 1e-3,
    "km": 1e6,
    "in": 25.4,
    "ft": 304.8,
}


def parsed_length(asked: str) -> tuple[float, float, str]:
    """The value, its standard deviation (0 if none is given) and the unit's name; raises ValueError."""
    match = _LENGTH.fullmatch(asked.strip())
    if match is None or match["first"] not in (None, "", match["unit"]):
        raise ValueError(f"'{asked}' is no length")
    value, deviation = float(match["value"]), float(match["deviation"] or 0.0)
    if not (0 < value < 1e30 and 0 <= deviation < value):
        raise ValueError(f"the length '{asked}' makes no sense")
    return value, deviation, match["unit"]
