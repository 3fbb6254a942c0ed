"""Changes as JSON, as CSV, and as lines for a terminal."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from .findings import KINDS, WITHIN, Changes, Region

#: The unit of lengths: px of the photos on the surface there.
UNIT = "px-equivalent"
_COLUMNS = ("kind", "x", "y", "z", "area", "value", "deviation", "low", "high", "unit", "direction", "places")


def as_plain(found: Changes) -> dict[str, Any]:
    """For JSON: regions, how much of the surface was seen and has changed, and what was separated from it."""
    aligned = found.alignment
    return {
        "regions": [_plain(region) for region in found.regions],
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
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 6)


def _plain(region: Region) -> dict[str, Any]:
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
        "unit": UNIT,
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


def json_text(found: Changes) -> str:
    """The content of change.json."""
    return json.dumps(as_plain(found), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def csv_text(found: Changes) -> str:
    """The content of change.csv: a row for each region."""
    out = io.StringIO()
    table = csv.DictWriter(out, _COLUMNS, lineterminator="\n", extrasaction="ignore")
    table.writeheader()
    for region in found.regions:
        row = _plain(region)
        table.writerow({**row, **dict(zip("xyz", row["centre"], strict=True))})
    return out.getvalue()


def lines(found: Changes) -> list[str]:
    """A sentence and a table for a terminal, and a word where px-equivalents are said."""
    said = [sentence(found)]
    if not found.regions:
        return said
    said += ["", f"{'what':<10} {'by':>7} {'95 % interval':>16}  {'area':>7}  {'where (first world)':<24} how"]
    for region in found.regions:
        low, high = interval(region)
        by = "-" if region.value is None else f"{region.value:.2f}"
        between = "-" if low is None else f"{low:.2f} to {high:.2f}"
        where = " ".join(f"{value:.4g}" for value in region.centre)
        how = region.direction or KINDS[region.kind]
        said.append(f"{region.kind:<10} {by:>7} {between:>16}  {region.area:>7.0f}  {where:<24} {how}")
    said += ["", "Lengths are px-equivalents: px of the photos on the surface there; areas are their squares"]
    return said


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
