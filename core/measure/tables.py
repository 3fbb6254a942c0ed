"""Measures as JSON, as CSV, and as lines for a terminal."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

from ..errors import FormatError
from .measured import NO_SCALE, Findings, Measured

#: Endings of the files that measures are written to.
SUFFIXES = (".json", ".csv")
_COLUMNS = ("name", "kind", "value", "deviation", "low", "high", "unit", "photos", "of", "reason")


def check_table_name(path: Path) -> None:
    """Raises FormatError where a name has no ending that can be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(
            f"'{path.name}' is no table that can be written", f"End its name with {' or '.join(SUFFIXES)}"
        )


def as_text(findings: Findings, suffix: str) -> str:
    """The whole content of a file."""
    rows = [one.plain() for one in findings.measures]
    if suffix == ".json":
        content = {"measures": rows, "places": findings.places, "noise": findings.noise}
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    out = io.StringIO()
    table = csv.DictWriter(out, _COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows([{**row, "of": " ".join(row["of"])} for row in rows])
    return out.getvalue()


def lines(findings: Findings) -> list[str]:
    """A table for a terminal, and a word where there is no scale."""
    found = [f"{'measure':<20} {'kind':<9} {'value':>12} {'+-':>10}   95 % interval"]
    found += [_line(one) for one in findings.measures]
    if any(one.unit.startswith(NO_SCALE) for one in findings.measures):
        found.append(
            "No length is known: px-equivalents are px of the photos on the surface there. Give one: --scale NAME=12mm"
        )
    return found


def _line(one: Measured) -> str:
    if one.value is None or one.deviation is None or one.low is None or one.high is None:
        return f"{one.name:<20} {one.kind:<9} {'-':>12} {'-':>10}   {one.reason}"
    interval = f"{one.low:.5g} to {one.high:.5g} {one.unit}"
    return f"{one.name:<20} {one.kind:<9} {one.value:>12.6g} {one.deviation:>10.3g}   {interval}"
