"""The tables of docs/studies/mutation.md, written from docs/studies/mutation.csv."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

Row = dict[str, str]
_BEGIN, _END = "<!-- written by `make mutants` -->", "<!-- end -->"
#: Standard deviations that hold 95 % of a normal distribution.
_SIGMAS = 1.96


def interval(hits: int, of: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    if of == 0:
        return 0.0, 1.0
    share, square = hits / of, _SIGMAS**2 / of
    middle = (share + square / 2) / (1 + square)
    half = _SIGMAS * math.sqrt(share * (1 - share) / of + square / (4 * of)) / (1 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


def _line(name: str, rows: Sequence[Row]) -> str:
    survived = [row for row in rows if row["outcome"] == "survived"]
    equivalent = sum(row["verdict"] == "equivalent" for row in survived)
    open_ones, of = len(survived) - equivalent, len(rows) - equivalent
    low, high = interval(open_ones, of)
    share = f"{100 * open_ones / of:.1f} %" if of else "-"
    said = f"{100 * low:.0f} to {100 * high:.0f} %"
    counts = f"{len(rows)} | {len(rows) - len(survived)} | {len(survived)} | {equivalent} | {open_ones}"
    return f"| {name} | {counts} | {share} | {said} |"


def table(rows: Iterable[Row]) -> str:
    """Markdown: a line for each package, one for its kernels alone, and the sum."""
    packages: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        packages[row["package"]].append(row)
    lines = [
        "| package | tried | killed | survived | of these equivalent | missing a test | of the non-equivalent | 95 % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for package, found in packages.items():
        lines.append(_line(package, found))
        kernels = [row for row in found if row["group"].endswith(" kernels")]
        if kernels:
            lines.append(_line("&nbsp;&nbsp;its kernels alone", kernels))
    lines.append(_line("**all**", [row for found in packages.values() for row in found]))
    return "\n".join(lines)


def survivors(rows: Iterable[Row]) -> str:
    """Markdown: each survivor with its verdict."""
    lines = ["| where | change | verdict |", "|---|---|---|"]
    for row in rows:
        if row["outcome"] == "survived":
            change = f"`{_cell(row['old'])}` -> `{_cell(row['new'])}`"
            where = f"{row['file'].removeprefix('core/')}:{row['line']}"
            lines.append(f"| {where} | {change} | {row['verdict'] or '?'}: {row['reason']} |")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("`", "'")


def write_tables(page: Path, rows: Sequence[Row]) -> None:
    """Puts the tables between the page's marks."""
    samples = list(dict.fromkeys(row["sample"] for row in rows))
    parts = []
    for sample in samples:
        own = [row for row in rows if row["sample"] == sample]
        parts.append(f"### Sample '{sample}'\n\n{table(own)}\n\nSurvivors:\n\n{survivors(own)}")
    text = page.read_text("utf-8")
    head, rest = text.split(_BEGIN)
    tail = rest.split(_END)[1]
    page.write_text(head + _BEGIN + "\n\n" + "\n\n".join(parts) + "\n\n" + _END + tail, "utf-8")
