"""The stress table: as lines on a terminal, as JSON, and as it stands in docs/stability.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.files import write_text
from .case import FAMILIES, Result
from .fuzz import Fuzzed
from .torture import TortureResult

#: Between these marks the command writes; the rest of the document is written by hand.
BEGIN, END = "<!-- written by run_dgs.py stress --markdown: begin -->", "<!-- end -->"


def verdict(passed: bool) -> str:
    """'pass' or 'FAIL'."""
    return "pass" if passed else "FAIL"


def figure(value: float) -> str:
    """A short number: counts as counts, errors with two digits."""
    if math.isnan(value):
        return "-"
    if value == int(value) and abs(value) < 1e4:
        return str(int(value))
    return f"{value:.1e}" if abs(value) < 0.01 else f"{value:.3g}"


def heading() -> str:
    """Above the lines of the cases."""
    return f"{'family':<11}{'case':<48}{'back end':<11}{'error':>9}  {'allowed':>9}  {'':<5} invariant"


def line(result: Result) -> str:
    """One case: family, name, back end, error, tolerance, pass or FAIL, invariant."""
    one = result.case
    said = f" [{result.raised}]" if result.raised else ""
    return (
        f"{one.family:<11}{one.name:<48}{result.backend or '-':<11}{figure(result.error):>9}  "
        f"{figure(one.tolerance):>9}  {verdict(result.passed):<5} {one.invariant}{said}"
    )


def fuzz_line(found: Fuzzed) -> str:
    """What random scenes gave."""
    return (
        f"{found.scenes} random scenes with {found.splats} splats: {found.non_finite} non-finite values, "
        f"{found.uncounted} splats uncounted, {sum(found.culled.values())} culled and counted ({found.seconds:.0f} s)"
    )


def torture_line(outcome: TortureResult) -> str:
    """One training: loss before and after, or why it stopped."""
    course = outcome.stopped or f"loss {figure(outcome.before)} -> {figure(outcome.after)}"
    return f"{verdict(outcome.passed)}  {outcome.name}: {course} ({outcome.seconds:.1f} s)"


def failures(results: Sequence[Result], found: Fuzzed | None, outcomes: Sequence[TortureResult]) -> int:
    """How many rows of all tables failed."""
    broken = 0 if found is None else int(found.non_finite + found.uncounted > 0)
    return sum(not r.passed for r in results) + broken + sum(not o.passed for o in outcomes)


def as_json(
    results: Sequence[Result],
    found: Fuzzed | None,
    outcomes: Sequence[TortureResult],
    machine: Mapping[str, Any],
    seconds: float,
) -> dict[str, Any]:
    """The same for programs: plain values, NaN as null."""

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "machine": dict(machine),
        "seconds": round(seconds, 1),
        "failed": failures(results, found, outcomes),
        "cases": [
            {
                "family": r.case.family,
                "name": r.case.name,
                "states": r.case.states,
                "invariant": r.case.invariant,
                "backend": r.backend or None,
                "error": number(r.error),
                "tolerance": r.case.tolerance,
                "reason": r.case.reason,
                "raised": r.raised or None,
                "seconds": round(r.seconds, 3),
                "passed": r.passed,
            }
            for r in results
        ],
        "fuzz": None
        if found is None
        else {
            "scenes": found.scenes,
            "splats": found.splats,
            "non_finite": found.non_finite,
            "uncounted": found.uncounted,
            "culled": found.culled,
            "seconds": round(found.seconds, 1),
            "seeds": found.worst,
        },
        "torture": [
            {
                "name": o.name,
                "before": number(o.before),
                "after": number(o.after),
                "non_finite": o.non_finite,
                "stopped": o.stopped or None,
                "seconds": round(o.seconds, 2),
                "passed": o.passed,
            }
            for o in outcomes
        ],
    }


def markdown(
    results: Sequence[Result],
    found: Fuzzed | None,
    outcomes: Sequence[TortureResult],
    machine: Mapping[str, Any],
    seconds: float,
) -> str:
    """The tables with the machine that they were measured on."""
    text = [f"Measured on {described(machine)}, in {seconds:.0f} s.", ""]
    for family in FAMILIES:
        mine = [r for r in results if r.case.family == family]
        if not mine:
            continue
        text += [f"### {family.upper() if len(family) == 3 else family.capitalize()}", ""]
        text += ["| case | what must hold | back end | error | allowed, because | |", "|---|---|---|---|---|---|"]
        text += [
            f"| {r.case.name} | {r.case.invariant} | {r.backend or '-'} | {figure(r.error)} | "
            f"{figure(r.case.tolerance)}: {r.case.reason} | {verdict(r.passed)} |"
            for r in mine
        ]
        text.append("")
    if found is not None:
        text += ["### Random scenes", "", fuzz_line(found) + ".", ""]
    if outcomes:
        text += ["### Trainings on bad scenes", "", "| scene | loss before | after | |", "|---|---|---|---|"]
        text += [
            f"| {o.name} | {figure(o.before)} | {o.stopped or figure(o.after)} | {verdict(o.passed)} |"
            for o in outcomes
        ]
        text.append("")
    return "\n".join(text)


def described(machine: Mapping[str, Any]) -> str:
    """The machine in words."""
    return f"{machine['cores']} cores of {machine['processor']}, {machine['memory_gb']} GB, device {machine['device']}"


def takes_tables(path: Path) -> bool:
    """Whether a document has a place for the tables."""
    try:
        return BEGIN in path.read_text("utf-8")
    except (OSError, ValueError):
        return False


def write_markdown(path: Path, tables: str) -> None:
    """Puts the tables between the marks of a document, or writes a document of them alone.

    Raises:
        OutputError: the file cannot be written.
    """
    before, after = "", ""
    if takes_tables(path):
        before, rest = path.read_text("utf-8").split(BEGIN, 1)
        after = rest.split(END, 1)[1] if END in rest else "\n"
    write_text(path, f"{before}{BEGIN}\n\n{tables}\n{END}{after}")
