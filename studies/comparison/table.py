"""Medians and spreads over seeds, and the comparison as a table that says what each figure means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median, pstdev
from typing import Any

from ...core.files import write_text

Row = dict[str, Any]

#: Bands of periods (px) that the table shows.
BANDS = ("14-10", "10-7")
#: What the paper reports of these figures: concordance of the red line for DGS and for plain splatting.
PAPER = {"dgs": 26.3, "plain": 3.95}
DEFINITION = (
    "Concordance = mean true width / mean |rendered width - true width| over the held-out views. The paper gives its"
    " ratio (26.3 for DGS, 3.95 for GS) without a definition; this one is ours."
)


def figures(row: Row) -> dict[str, float | None]:
    """The figures of one row by flat name; None where there is nothing to compare with."""
    held = row["heldout"]
    out: dict[str, float | None] = {
        name: held.get(name)
        for name in ("psnr", "ssim", "psnr_inside", "psnr_object", "edge_sharpness", "degraded_psnr")
    }
    out["fitted_psnr"] = row["fitted"]["psnr"]
    for band in BANDS:
        for kind in ("gain", "correlation", "energy"):
            out[f"{band} {kind}"] = held["bands"].get(band, {}).get(kind)
    for line, entry in (row.get("lines") or {}).items():
        for name in ("concordance", "concordance_all_views", "true_mean", "rendered_mean"):
            out[f"{line} {name}"] = entry[name]
    for name, value in (row.get("depth") or {}).items():
        out[f"depth {name}"] = value
    out["seconds"] = row["seconds"]["wall"] + row["seconds"].get("deconvolution", 0.0)
    out["cpu_seconds"] = row["seconds"]["cpu"]
    return out


def summarised(rows: Sequence[Row], choosable: Sequence[str] = ()) -> dict[str, Any]:
    """Median and spread of every figure by method, and which baselines stand out.

    Args:
        choosable: rows of deconvolved photos that one could choose without the truth.

    Returns:
        'each': by method {'seeds', 'estimate', 'median': {figure: value}, 'spread': {figure: standard deviation}};
        'best_wiener' and 'best_rl': by the truth's PSNR; 'without_truth': those of `choosable` that were run.
    """
    each: dict[str, Any] = {}
    estimates = {row["method"]: row.get("estimate", "") for row in rows}
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [figures(row) for row in rows if row["method"] == method]
        entry: dict[str, Any] = {"seeds": len(own), "estimate": estimates.get(method, ""), "median": {}, "spread": {}}
        for name in dict.fromkeys(name for one in own for name in one):
            values = [value for one in own if (value := one.get(name)) is not None]
            entry["median"][name] = round(median(values), 7) if values else None
            entry["spread"][name] = round(pstdev(values), 7) if len(values) > 1 else None
        each[method] = entry
    return {
        "each": each,
        "best_wiener": best(each, "wiener"),
        "best_rl": best(each, "rl"),
        "without_truth": [method for method in choosable if method in each],
    }


def best(each: dict[str, Any], kind: str) -> str | None:
    """The method of this kind with the highest median PSNR."""
    scored = {m: e["median"]["psnr"] for m, e in each.items() if m.split()[0] == kind and e["median"]["psnr"]}
    return max(scored, key=lambda method: scored[method]) if scored else None


def cell(entry: dict[str, Any], name: str, digits: int, factor: float = 1.0) -> str:
    """'26.13 ± 0.02', or '-'."""
    value, spread = entry["median"].get(name), entry["spread"].get(name)
    if value is None:
        return "-"
    return f"{value * factor:.{digits}f}" + ("" if spread is None else f" ± {spread * factor:.{digits}f}")


def table_lines(facts: dict[str, Any], summary: dict[str, Any], only: Sequence[str] | None = None) -> list[str]:
    """The table alone, as lines of Markdown; `only` picks methods."""
    lines = [
        name.removesuffix(" concordance")
        for entry in summary["each"].values()
        for name in entry["median"]
        if name.endswith(" concordance")
    ]
    names = list(dict.fromkeys(lines))
    depth = any("depth median" in entry["median"] for entry in summary["each"].values())
    heads = ["method", "PSNR", "SSIM", "edges", *(f"{band} px gain / corr." for band in BANDS)]
    for name in names:
        heads += [f"{name}: concordance", "width, true -> rendered (px)"]
    heads += ["depth error (mm)" if facts.get("metres") else "depth error"] if depth else []
    heads += ["seconds", "seeds"]
    out = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for method, entry in summary["each"].items():
        if only is not None and method not in only:
            continue
        middle = entry["median"]
        cells = [
            _named(method, summary),
            cell(entry, "psnr", 2),
            cell(entry, "ssim", 3),
            cell(entry, "edge_sharpness", 2),
        ]
        cells += [f"{_plain(middle.get(f'{b} gain'))} / {_plain(middle.get(f'{b} correlation'))}" for b in BANDS]
        for name in names:
            cells.append(cell(entry, f"{name} concordance", 1))
            cells.append(f"{_plain(middle.get(f'{name} true_mean'))} -> {_plain(middle.get(f'{name} rendered_mean'))}")
        if depth:
            cells.append(cell(entry, "depth median", 2, 1000.0 if facts.get("metres") else 1.0))
        cells += [cell(entry, "seconds", 1), str(entry["seeds"])]
        out.append("| " + " | ".join(cells) + " |")
    return out


def columns(facts: dict[str, Any]) -> str:
    """What the columns of the table mean."""
    return (
        "PSNR (dB), SSIM: sharp render against sharp photo, held-out views, sRGB. Edges: slope across the truth's"
        " strongest edges, 1 is the truth's. 'wiener n vW': every photo after Wiener's filter with noise-to-signal n,"
        " 'rl N vW': after N iterations of Richardson-Lucy (scikit-image), then splatting with total variation W;"
        " 'measured': n or N as estimated from the photos themselves. Rows of one seed were run for the search alone."
        " Bands: gain (1: all there) and correlation (1: all true) of detail with"
        " periods in that range. " + DEFINITION + " A width is where the flanks pass half-way between line and"
        " surroundings, measured alike in truth and render; a line that is not found counts as width 0."
        + (" Depth: median over opaque pixels of held-out views." if facts.get("metres") else "")
    )


def conditions(facts: dict[str, Any]) -> list[str]:
    """What was compared, as paragraphs."""
    limits = ", ".join(f"{cut} cycles/px: {_plain(value)} dB" for cut, value in facts["truth_low_passed_psnr"].items())
    lines = [
        f"{facts['registered']} of {facts['photos']} photos of {facts['size'][0]} x {facts['size'][1]} px,"
        f" {len(facts['heldout'])} held out; PSF {facts['psf']} in {facts['blur_space']} values; cameras:"
        f" {facts['cameras']}; grid step {facts['grid_step']}, {facts['steps']} steps, at most"
        f" {facts['max_gaussians']} Gaussians, {facts['seeds']} seed{'s' if facts['seeds'] > 1 else ''}"
        f" (median ± standard deviation). The sharp photos themselves without what is finer than {limits}."
    ]
    if facts.get("poses") and facts["cameras"] != "known":
        poses = facts["poses"]
        lines.append(
            f"Cameras against the set's own, after similarity alignment (medians): centre"
            f" {_plain(poses['centre_px_median'])} px-equivalent, orientation {poses['angle_degrees_median']} degrees,"
            f" focal length {poses['focal_percent']} %."
        )
    return lines


def write(path: Path, content: dict[str, Any]) -> None:
    """Writes the whole comparison as Markdown, with the pictures beside it."""
    facts = content["facts"]
    parts = [f"# Comparison: {facts['set']}"]
    if facts.get("quick"):
        parts.append("**A quick run: small pictures and short trainings. It proves the machinery, not the method.**")
    parts += [*conditions(facts), columns(facts), "\n".join(table_lines(facts, content["methods"]))]
    parts += shown(content.get("pictures", {}))
    write_text(path, "\n\n".join(parts) + "\n")


def shown(pictures: Mapping[str, str]) -> list[str]:
    """Pictures (title by link) as paragraphs of Markdown: movies that pages cannot show are links in one line."""
    parts = [f"![{title}]({link})" for link, title in pictures.items() if not link.endswith(".mp4")]
    movies = [f"[{title}]({link})" for link, title in pictures.items() if link.endswith(".mp4")]
    return parts + ([" · ".join(movies)] if movies else [])


def _named(method: str, summary: dict[str, Any]) -> str:
    marks = []
    if method in (summary["best_wiener"], summary["best_rl"]):
        marks.append("best by the truth")
    if method in summary["without_truth"]:
        marks.append("chosen without truth")
    if summary["each"][method]["estimate"]:
        marks.append(summary["each"][method]["estimate"])
    return f"{method} ({'; '.join(marks)})" if marks else method


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
