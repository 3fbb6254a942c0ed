"""Means over seeds, the best and the choosable baseline, as a small table."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean, pstdev
from typing import Any

COLUMNS = ("psnr", "ssim", "psnr_inside", "degraded_psnr")


def mean(values: Sequence[float | None]) -> float | None:
    """Of what is there; None if nothing is."""
    known = [value for value in values if value is not None]
    return round(fmean(known), 4) if known else None


def summarised(rows: list[dict[str, Any]], choosable: str) -> dict[str, Any]:
    """One entry per method, and which Wiener row is best (by the truth) and which one could be chosen.

    Args:
        choosable: the Wiener row that needs no truth.
    """
    out: dict[str, Any] = {"each": {}, "best_wiener": None, "wiener_without_truth": None}
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        psnrs = [row["heldout"]["psnr"] for row in own if row["heldout"]["psnr"] is not None]
        out["each"][method] = {
            "seeds": len(own),
            "heldout": {name: mean([row["heldout"][name] for row in own]) for name in COLUMNS},
            "fitted": {name: mean([row["fitted"][name] for row in own]) for name in COLUMNS},
            "heldout_psnr_spread": round(pstdev(psnrs), 4) if psnrs else None,
            "seconds": {name: mean([row["seconds"][name] for row in own]) for name in ("wall", "cpu")},
        }
    wiener = {m: v["heldout"]["psnr"] for m, v in out["each"].items() if m.startswith("wiener")}
    if any(value is not None for value in wiener.values()):
        out["best_wiener"] = max(wiener, key=lambda m: wiener[m] if wiener[m] is not None else -1.0)
    if choosable in wiener:
        out["wiener_without_truth"] = choosable
    return out


def markdown(facts: dict[str, Any], summary: dict[str, Any]) -> str:
    """The table, with what the figures mean."""
    limits = ", ".join(f"{cut} cycles/px {value} dB" for cut, value in facts["truth_low_passed_psnr"].items())
    lines = [
        f"# Accuracy: {facts['set']}", "",
        f"{facts['registered']} of {facts['photos']} photos, {len(facts['heldout'])} held out; PSF {facts['psf']};"
        f" grid step {facts['grid_step']}, {facts['steps']} steps, at most {facts['max_gaussians']} Gaussians."
        " PSNR in dB of the sharp render against the sharp photo, sRGB, mean over views and seeds;"
        " 'inside': without a border of 30 px; 'through': degraded render against blurred photo.",
        f"The sharp photos themselves without what is finer than: {limits}.", "",
        "| method | PSNR | ± seeds | SSIM | inside | through | fitted PSNR | seconds | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for method, entry in summary["each"].items():
        marks = []
        if method == summary["best_wiener"]:
            marks.append("best by the truth")
        if method == summary["wiener_without_truth"]:
            marks.append("chosen without truth")
        name = f"{method} ({', '.join(marks)})" if marks else method
        held, fitted, seconds = entry["heldout"], entry["fitted"], entry["seconds"]
        cells = [name, held["psnr"], entry["heldout_psnr_spread"], held["ssim"], held["psnr_inside"],
                 held["degraded_psnr"], fitted["psnr"], seconds["wall"], seconds["cpu"]]  # fmt: skip
        lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else "-" if value is None else str(value)
