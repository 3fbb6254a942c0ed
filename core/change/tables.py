"""Changes as JSON, as CSV, and as lines for a terminal."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

from .findings import KINDS, WITHIN, Changes, Region

_COLUMNS = ("kind", "x", "y", "z", "area", "value", "deviation", "low", "high", "unit", "direction", "places")


def as_plain(found: Changes, colours: Mapping[str, Any]) -> dict[str, Any]:
    """For JSON: regions, how much of the surface was seen and has changed, and what was separated from it.

    Args:
        colours: of the mesh, see `picture.legend`.
    """
    aligned = found.alignment
    return {
        "regions": [_plain(found, region) for region in found.regions],
        "scale": _scale(found),
        "surface": {"places": found.asked, "held": int(found.held.sum()), "changed": _rounded(found.changed)},
        "alignment": {
            "how": aligned.how,
            "matches": aligned.matches,
            "scale": aligned.similarity.scale,
            "rotation": aligned.similarity.rotation.tolist(),
            "translation": aligned.similarity.translation.tolist(),
            "deviation": _rounded(aligned.deviation),
            "taken_out": _rounded(aligned.taken),
        },
        "light": {"gain": _rounded(found.gain)},
        "medium": {"before": found.mediums[0], "after": found.mediums[1]},
        "colours": dict(colours),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 6)


def _scale(found: Changes) -> dict[str, Any] | None:
    if found.scale is None:
        return None
    known = found.scale.known
    given = {"measure": known.measure, "value": known.value, "deviation": known.deviation, "unit": known.unit}
    return {**given, "size": found.scale.size, "size_deviation": found.scale.deviation}


def _plain(found: Changes, region: Region) -> dict[str, Any]:
    region = found.said(region)
    low, high = interval(region)
    return {
        "kind": region.kind,
        "centre": region.centre.tolist(),
        "pixel": float(region.pixel),
        "area": _rounded(region.area),
        "value": _rounded(region.value),
        "deviation": _rounded(region.deviation),
        "low": _rounded(low),
        "high": _rounded(high),
        "unit": found.unit,
        "motion": [_rounded(value) for value in region.motion],
        "direction": region.direction,
        "places": len(region.places),
        "on": "after" if region.after else "before",
    }


def interval(region: Region) -> tuple[float | None, float | None]:
    """The 95 % interval of the value."""
    if region.value is None or region.deviation is None:
        return None, None
    return max(0.0, region.value - WITHIN * region.deviation), region.value + WITHIN * region.deviation


def json_text(found: Changes, colours: Mapping[str, Any]) -> str:
    """The content of change.json, see `as_plain`."""
    return json.dumps(as_plain(found, colours), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def csv_text(found: Changes) -> str:
    """The content of change.csv: a row for each region."""
    out = io.StringIO()
    table = csv.DictWriter(out, _COLUMNS, lineterminator="\n", extrasaction="ignore")
    table.writeheader()
    for region in found.regions:
        row = _plain(found, region)
        table.writerow({**row, **dict(zip("xyz", row["centre"], strict=True))})
    return out.getvalue()


def lines(found: Changes) -> list[str]:
    """A sentence and a table for a terminal, and a word where px-equivalents are said."""
    said = [sentence(found)]
    if not found.regions:
        return said
    said += ["", f"{'what':<10} {'by':>7} {'95 % interval':>16}  {'area':>7}  {'where (first world)':<24} how"]
    for region in map(found.said, found.regions):
        low, high = interval(region)
        by = "-" if region.value is None else _short(region.value)
        between = "-" if low is None or high is None else f"{_short(low)} to {_short(high)}"
        where = " ".join(f"{value:.4g}" for value in region.centre)
        how = region.direction or KINDS[region.kind]
        said.append(f"{region.kind:<10} {by:>7} {between:>16}  {region.area:>7,.4g}  {where:<24} {how}")
    return [*said, "", _units(found)]


def _short(value: float) -> str:
    """Two digits behind the point, or three in all where it is small."""
    return f"{value:.2f}" if value >= 1 or value == 0 else f"{value:.3g}"


def _units(found: Changes) -> str:
    if found.scale is None:
        return (
            "Lengths are px-equivalents: px of the photos on the surface there; areas are their squares. "
            "A known length gives them a unit: --measures FILE --scale NAME=12mm"
        )
    known = found.scale.known
    length = (
        f"{known.value:g} +- {known.deviation:g} {known.unit}" if known.deviation else f"{known.value:g} {known.unit}"
    )
    return f"Lengths are {known.unit}, for '{known.measure}' is {length}; areas are their squares"


def sentence(found: Changes) -> str:
    """What has changed, in one sentence."""
    held = int(found.held.sum())
    seen = f"{held} of {found.asked} places are held by photos of both"
    if not found.regions:
        return f"Nothing has changed beyond chance: {seen}"
    counts = [(kind, sum(region.kind == kind for region in found.regions)) for kind in KINDS]
    parts = ", ".join(f"{count} {kind}" for kind, count in counts if count)
    share = f"{100 * found.changed:.1f} % of the surface"
    return f"{len(found.regions)} region{'s' * (len(found.regions) != 1)} changed ({parts}), {share}; {seen}"
