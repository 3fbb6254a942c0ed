"""docs/benchmark.md: the table, what time brings, the worst views, and what was said by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .scenes import BenchmarkScene, Part, PhotoSet, RenderedSet

Row = Mapping[str, Any]

#: What stands below this line is kept when the page is written again.
BY_HAND = "<!-- written by hand from here on; the command keeps it -->"
#: A worst view this far (dB) below the mean is marked: one view is seen otherwise than the others.
FAR_BELOW = 3.0
#: A doubling of time that gains less (dB) has brought nothing.
GAINS = 0.05

_PARTS: tuple[tuple[Part, str], ...] = (
    ("checked on", "No number of the engine was chosen on these sets, and none may be."),
    (
        "chosen on",
        "Numbers of the engine were chosen on these sets ([constants.md](constants.md)): read them as upper bounds.",
    ),
)


def page(content: Mapping[str, Any], scenes: Sequence[BenchmarkScene], by_hand: str = "") -> str:
    """The whole page as Markdown.

    Args:
        content: of benchmark.json: rows, efforts, machine, quick, missing, pictures.
        by_hand: what stands below the generated part.
    """
    rows: dict[tuple[str, str], Row] = {(row["scene"], row["effort"]): row for row in content["rows"]}
    parts = ["# Benchmark"]
    if content["quick"]:
        parts.append("**Written by a quick run: tiny pictures. These are not results.**")
    parts.append(_introduction())
    presets = [name for name in content["efforts"] if not name.endswith(" min")]
    for part, meaning in _PARTS:
        own = [scene for scene in scenes if scene.part == part and any(scene.name == name for name, _ in rows)]
        if own:
            parts += [f"## {part.capitalize()}", meaning, "\n".join(table(own, rows, presets))]
    parts += _doublings(scenes, rows, [name for name in content["efforts"] if name.endswith(" min")])
    parts += _fronts(scenes, rows, content["efforts"])
    if presets:
        parts += ["## What it took, and what the run said of itself", "\n".join(details(scenes, rows, presets[-1]))]
    if content["pictures"]:
        parts += ["## Worst views", _OF_PICTURES]
        parts += [f"**{scene}**, {words}\n\n![{scene}]({link})" for scene, words, link in content["pictures"]]
    parts.append(_closing(content))
    return "\n\n".join(parts) + f"\n\n{BY_HAND}\n{by_hand}"


def kept_by_hand(text: str) -> str:
    """What an earlier page has below the generated part."""
    return text.partition(f"{BY_HAND}\n")[2]


def table(scenes: Sequence[BenchmarkScene], rows: Mapping[tuple[str, str], Row], efforts: Sequence[str]) -> list[str]:
    """A line for each scene: mean and worst PSNR of held-out views and seconds for each effort."""
    lines = [
        "| scene | kind | photos | medium | cameras | " + " | ".join(efforts) + " | published |",
        "|---|---|---|---|---|" + "---|" * len(efforts) + "---|",
    ]
    for scene in scenes:
        found = [rows.get((scene.name, effort)) for effort in efforts]
        any_row = next((row for row in found if row and not row["failed"]), None)
        photos = "-" if any_row is None else "{} of {} x {}".format(any_row["photos"], *any_row["size"])
        cameras: str = scene.cameras
        if any_row is not None and scene.cameras == "found":
            cameras += f": {any_row['registered']}"
        cells = " | ".join(cell(row) for row in found)
        start = f"| {scene.name} | {scene.kind} | {photos} | {medium(scene)} | {cameras} | "
        lines.append(f"{start}{cells} | {scene.published or '-'} |")
    return lines


def medium(scene: BenchmarkScene) -> str:
    """What is between the scene and its photos, in words."""
    source: RenderedSet | PhotoSet = scene.source
    if source.psf != "none":
        return f"sigma {source.psf.removeprefix('gaussian:')} px"
    return {"drinks": "a large aperture, unknown", "tea": "shaken, unknown"}.get(scene.name, "sharp")


def cell(row: Row | None) -> str:
    """Mean, worst and seconds of one run."""
    if row is None:
        return "-"
    if row["failed"]:
        return "**failed**"
    worst = f"{row['worst']['psnr']:.1f}"
    if row["psnr"] - row["worst"]["psnr"] > FAR_BELOW:
        worst = f"**{worst}**"
    return f"{row['psnr']:.2f} ({worst}) in {row['seconds']:.0f} s"


def details(scenes: Sequence[BenchmarkScene], rows: Mapping[tuple[str, str], Row], effort: str) -> list[str]:
    """SSIM, size and verdict of each scene's run with one effort."""
    lines = [
        f"| scene ({effort}) | SSIM | Gaussians, degree | steps | memory | others' load | verdict "
        "| explained: unseen, fitted |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene in scenes:
        row = rows.get((scene.name, effort))
        if row is None:
            continue
        if row["failed"]:
            lines.append(f"| {scene.name} | - | - | - | - | - | failed: {row['failed']} | - |")
            continue
        others = "-" if row["others"] is None else f"{100 * row['others']:.0f} %"
        size = f"{row['gaussians']:,}, {row['sh_degree']} | {row['steps']:,} | {row['peak_memory_mb']:.0f} MB"
        shares = ", ".join("-" if share is None else f"{share:.1f} %" for share in row["explained"])
        lines.append(f"| {scene.name} | {row['ssim']:.3f} | {size} | {others} | {row['level']} | {shares} |")
    return lines


def _doublings(
    scenes: Sequence[BenchmarkScene], rows: Mapping[tuple[str, str], Row], limits: Sequence[str]
) -> list[str]:
    if not limits:
        return []
    lines = ["| scene | " + " | ".join(limits) + " | |", "|---|" + "---|" * len(limits) + "---|"]
    for scene in scenes:
        found = [rows.get((scene.name, limit)) for limit in limits]
        if any(row is not None for row in found):
            lines.append(f"| {scene.name} | {' | '.join(_limited(row) for row in found)} | {rises(found)} |")
    words = (
        "`--time-limit`, held-out views: mean PSNR (worst view) and steps. A run that ended before its time, because"
        " held-out photos gained no more, is marked with the seconds it took."
    )
    return ["## Does longer bring more?", words, "\n".join(lines)]


def _fronts(scenes: Sequence[BenchmarkScene], rows: Mapping[tuple[str, str], Row], efforts: Sequence[str]) -> list[str]:
    """Presets and time limits of each scene side by side; nothing where no scene has both."""
    lines = ["| scene | all runs, the quickest first | presets that a quicker run beats |", "|---|---|---|"]
    for scene in scenes:
        runs = [row for effort in efforts if (row := rows.get((scene.name, effort))) and not row["failed"]]
        if len({_is_limit(row) for row in runs}) == 2:
            scored = on_common_views(runs)
            shown = "; ".join(f"{row['effort']} {row['seconds']:.0f} s {psnr:.2f}" for row, psnr in scored)
            lines.append(f"| {scene.name} | {shown} | {', '.join(beaten(scored)) or 'none'} |")
    words = (
        "Seconds from the command to the report, and the mean PSNR over the held-out views that all these runs scored"
        " (a run with a short limit scores fewer). A preset is beaten where a quicker run of this table is more than"
        f" {GAINS:g} dB better."
    )
    return ["## Are presets worth their time?", words, "\n".join(lines)] if len(lines) > 2 else []


def _is_limit(row: Row) -> bool:
    return str(row["effort"]).endswith(" min")


def on_common_views(runs: Sequence[Row]) -> list[tuple[Row, float]]:
    """Runs of a scene, the quickest first, each with its mean PSNR over the views that all of them scored."""
    common = sorted(set.intersection(*(set(row["views"]) for row in runs)))
    means = [(row, sum(row["views"][name] for name in common) / max(1, len(common))) for row in runs]
    return sorted(means, key=lambda found: float(found[0]["seconds"]))


def beaten(scored: Sequence[tuple[Row, float]]) -> list[str]:
    """Presets that a quicker run is better than, with that run."""
    found = []
    for place, (row, psnr) in enumerate(scored):
        best = max(scored[:place], key=lambda other: other[1], default=None)
        if not _is_limit(row) and best is not None and best[1] > psnr + GAINS:
            found.append(f"{row['effort']} ({best[0]['effort']}: {best[1] - psnr:+.2f} dB)")
    return found


def _limited(row: Row | None) -> str:
    if row is None or row["failed"]:
        return "-" if row is None else "**failed**"
    ended = f", ended after {row['seconds']:.0f} s" if row["status"] == "plateau" else ""
    return f"{row['psnr']:.2f} ({row['worst']['psnr']:.1f}), {row['steps']:,}{ended}"


def rises(found: Sequence[Row | None]) -> str:
    """Whether every doubling gains, or the run ended by evidence; on the views that all of them scored."""
    there = [row for row in found if row is not None and not row["failed"]]
    scores = {row["effort"]: psnr for row, psnr in on_common_views(there)} if there else {}
    for before, after in zip(there[:-1], there[1:], strict=True):
        gained = scores[after["effort"]] - scores[before["effort"]]
        if gained < -GAINS:
            return f"**falls** at {after['effort']}"
        if gained < GAINS and after["status"] != "plateau":
            return f"nothing gained at {after['effort']}"
    return "rises, or ended by evidence" if len(there) > 1 else "-"


_OF_PICTURES = (
    "The worst held-out view of each scene that the laboratory rendered: the sharp truth, the twin, three times their"
    " difference."
)


def _introduction() -> str:
    return (
        "`make benchmark` runs the product as a user runs it (`run_dgs.py reconstruct`, no other setting than what the"
        " columns say) on scenes of many kinds, and scores views that nothing was trained on: every eighth. The scenes"
        " are split once, in `studies/benchmark/scenes.py`: a number that is better on the sets it was chosen on and"
        " worse on the others has learned them by heart.\n\n"
        "Cells have the mean PSNR in dB over held-out views (the worst view; **bold** where it is more than"
        f" {FAR_BELOW:g} dB below the mean) and the seconds from the command to the report. PSNR is against the sharp"
        " picture where there is one, else against the photo. *Given* cameras come without points, as Blender's"
        " exporters write them (drinks and tea: COLMAP models with points); *found*: how many of the photos got one."
    )


def _closing(content: Mapping[str, Any]) -> str:
    machine = content["machine"]
    words = [f"Measured on {machine['processor']}, {machine['cores']} cores, device {machine['device']}."]
    busy = [row["others"] for row in content["rows"] if row.get("others") is not None]
    if busy and max(busy) > 0.1:
        words.append(
            f"The machine was shared: others used {100 * min(busy):.0f} to {100 * max(busy):.0f} % of it meanwhile, so"
            " that seconds are upper bounds and runs with a time limit got fewer steps than on a quiet machine."
        )
    engines = {row["engine"] for row in content["rows"]}
    if len(engines) > 1:
        words.append(f"Rows are of {len(engines)} states of the engine; `--again` runs those of earlier ones anew.")
    if content["missing"]:
        words.append(f"Sets that were not there: {', '.join(content['missing'])}.")
    words.append(
        '`make benchmark ARGS="--data FOLDER"` (FOLDER: the shared sets) takes up what is there; `--presets draft'
        " balanced best`, `--minutes 1 2 4 8`, `--only NAME`. Rows are in `benchmarks/benchmark.json`."
    )
    return " ".join(words)
