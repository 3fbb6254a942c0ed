"""Medians over seeds, what a given time buys, and which points nothing beats."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median, pstdev
from typing import Any

Row = dict[str, Any]

#: Seconds of the column that says what a minute buys.
SHORT = 60.0
#: Below the best point, in dB: the target whose time is reported if nobody names one.
BELOW_BEST = 0.5


def line_error(row: Row) -> float | None:
    """Mean of |rendered - true| / true width over held-out views and painted lines, in %; None without lines."""
    errors = []
    for line in (row.get("lines") or {}).values():
        for view in line["views"]:
            if view["heldout"] and view["true"] and view["rendered"] is not None:
                errors.append(abs(view["rendered"] - view["true"]) / view["true"])
    return 100.0 * sum(errors) / len(errors) if errors else None


def time_to(row: Row, target: float) -> float | None:
    """Seconds until the accuracy was `target` dB for the first time, interpolated; None if never."""
    before: tuple[float, float] | None = None
    for seconds, psnr in row["curve"]:
        if psnr >= target:
            if before is None or psnr == before[1]:
                return float(seconds)
            share = (target - before[1]) / (psnr - before[1])
            return float(before[0] + share * (seconds - before[0]))
        before = seconds, psnr
    return None


def best_within(row: Row, seconds: float) -> float | None:
    """The best accuracy (dB) seen by then; None if there was none yet."""
    seen = [psnr for at, psnr in row["curve"] if at <= seconds]
    return max(seen) if seen else None


def points(rows: Sequence[Row], target: float | None = None) -> tuple[list[dict[str, Any]], float | None]:
    """One point per knob in the order of the rows, and the target (dB) whose time is reported.

    Each has knob, group, seeds, seconds, psnr, ssim, line_error, time_to_target, best_in_60 (medians), seconds_spread,
    psnr_spread (standard deviations), gaussians, steps, front, skipped ('' or why), disturbed.
    """
    whole = [row for row in rows if not row.get("skipped")]
    if target is None and whole:
        best = max(_psnr([r for r in whole if r["knob"] == knob]) for knob in {r["knob"] for r in whole})
        target = round(best - BELOW_BEST, 2)
    found: list[dict[str, Any]] = []
    for knob in dict.fromkeys(row["knob"] for row in rows):
        own = [row for row in rows if row["knob"] == knob]
        skipped = next((row["skipped"] for row in own if row.get("skipped")), "")
        point: dict[str, Any] = {"knob": knob, "group": own[0]["group"], "seeds": len(own), "skipped": skipped}
        if not skipped:
            seconds, psnrs = [r["seconds"]["total"] for r in own], [r["heldout"]["psnr"] for r in own]
            point |= {
                "seconds": median(seconds),
                "seconds_spread": pstdev(seconds),
                "psnr": median(psnrs),
                "psnr_spread": pstdev(psnrs),
                "ssim": median(r["heldout"]["ssim"] for r in own),
                "line_error": _median(line_error(r) for r in own),
                "time_to_target": None if target is None else _median((time_to(r, target) for r in own), all_of=True),
                "best_in_60": _median((best_within(r, SHORT) for r in own), all_of=True),
                "gaussians": median(r["gaussians"] for r in own),
                "steps": median(r["steps"] for r in own),
                "disturbed": _median(r.get("disturbed") for r in own),
            }
        found.append(point)
    measured = [point for point in found if not point["skipped"]]
    for point in measured:
        point["front"] = not any(dominates(other, point) for other in measured)
    return found, target


def dominates(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """At least as quick and as exact, and better in one of them."""
    no_worse = one["seconds"] <= other["seconds"] and one["psnr"] >= other["psnr"]
    return bool(no_worse and (one["seconds"] < other["seconds"] or one["psnr"] > other["psnr"]))


def _psnr(rows: Sequence[Row]) -> float:
    return float(median(row["heldout"]["psnr"] for row in rows))


def _median(values: Iterable[float | None], all_of: bool = False) -> float | None:
    """Of the values that are there; with `all_of` None as soon as one is missing."""
    everything = list(values)
    there = [value for value in everything if value is not None]
    if not there or (all_of and len(there) < len(everything)):
        return None
    return float(median(there))
