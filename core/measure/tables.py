"""Measures as JSON, as CSV, and as lines for a terminal."""

from __future__ import annotations

from typing import Any

from .measured import Findings, Measured
from .rows import NO_SCALE, table_text


def as_plain(findings: Findings) -> dict[str, Any]:
    """For JSON: measures, places that were found, why others were not, the photos' noise, and the scale of a board."""
    scale = {} if findings.scale is None else {"scale": findings.scale}
    return {
        "measures": [one.plain() for one in findings.measures],
        "places": findings.places,
        "missing": findings.missing,
        "noise": findings.noise,
        **scale,
    }


def as_text(findings: Findings, suffix: str) -> str:
    """The whole content of a file."""
    content = as_plain(findings)
    return table_text(content.pop("measures"), suffix, **content)


def lines(findings: Findings) -> list[str]:
    """A table for a terminal, and a word where there is no scale."""
    found = [f"{'measure':<20} {'kind':<9} {'value':>12} {'+-':>10}   95 % interval"]
    found = [*found, *map(_line, findings.measures)] if findings.measures else []
    found += [findings.said] if findings.said else []
    if any(one.unit.startswith(NO_SCALE) for one in findings.measures):
        found.append(
            "No length is known: px-equivalents are px of the photos on the surface there. Give one: --scale NAME=12mm,"
            " or print markers: --board aruco:40mm"
        )
    return found


def _line(one: Measured) -> str:
    if one.value is None or one.deviation is None or one.low is None or one.high is None:
        return f"{one.name:<20} {one.kind:<9} {'-':>12} {'-':>10}   {one.reason}"
    interval = f"{one.low:.5g} to {one.high:.5g} {one.unit}"
    return f"{one.name:<20} {one.kind:<9} {one.value:>12.6g} {one.deviation:>10.3g}   {interval}"
