"""Mutation testing: breaks one small thing of the engine at a time, and the tests must see it.

    python -m tools.mutation --seed WORD [--trace] [--only NAME ...] [--scale X] [--seconds S] [--wide] [--page]

A seeded sample of each package's mutants (`draw.py`) is run against the tests that reach the mutated statement: those
beside the package, with `--wide` those anywhere else, too. The packages take turns, a sixth of each at a time, so that
none is left out where the time ends. Kernels are compiled anew for each. What was tried is kept in
docs/studies/mutation.csv, so that a run that was cut off goes on where it stopped. A survivor's `verdict` in that table
is written by hand and kept; `--again --seconds 600` asks those that are not equivalent again, with all tests beside.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from .groups import GROUPS, Group
from .page import write_tables
from .reach import Reach
from .selection import Selection
from .table import Table
from .tree import ROOT, copied, forked, preload

#: Tests of the second line, those elsewhere, stop when they would take longer together (s, as traced).
_SECOND = 60.0
#: Turns in which a sample is tried.
_ROUNDS = 6
#: Longest trace of a folder of tests (s).
_TRACE = 3000.0


def cache_base() -> Path:
    """Where the copy, its compiled kernels and the lists lie."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dgs" / "mutants" / ROOT.name


def prepare(base: Path, anew: bool) -> None:
    """A copy of the tree, without what a run that was killed left mutated."""
    if anew:
        for name in ("tree", "pristine", "reach"):
            shutil.rmtree(base / name, ignore_errors=True)
    if not (base / "pristine").is_dir():
        copied(base / "tree")
        shutil.copytree(base / "tree" / "core", base / "pristine" / "core")
    for path in (base / "pristine").rglob("*.py"):
        now = base / "tree" / path.relative_to(base / "pristine")
        if now.read_bytes() != path.read_bytes():
            shutil.copy2(path, now)


def drawn(base: Path, seed: str, groups: list[Group], scale: float) -> list[dict[str, Any]]:
    """The sample, made by cosmic-ray in an environment of its own."""
    python = base / "venv" / "bin" / "python"
    if not python.is_file():
        subprocess.run([sys.executable, "-m", "venv", base / "venv"], check=True)
        wanted = ROOT / "tools/mutation/requirements.txt"
        subprocess.run([python, "-m", "pip", "install", "-q", "-r", wanted], check=True)
    request = {
        "seed": seed,
        "tree": str(base / "tree"),
        "groups": [
            {"name": g.name, "package": g.package, "files": g.files(base / "tree"), "count": round(g.count * scale)}
            for g in groups
        ],
    }
    command = [python, ROOT / "tools/mutation/draw.py"]
    made = subprocess.run(command, input=json.dumps(request).encode(), stdout=subprocess.PIPE, check=True)
    return list(json.loads(made.stdout))


def reached(base: Path, targets: list[str], watched: set[str]) -> dict[str, Any]:
    """Which tests run which lines; kept until asked for anew (`--trace`)."""
    merged: dict[str, Any] = {"tests": {}, "shared": {}, "failed": []}
    for target in targets:
        part = base / "reach" / (target.replace("/", ".") + ".json")
        if not part.is_file():
            part.parent.mkdir(parents=True, exist_ok=True)
            print(f"tracing {target}", flush=True)
            task = partial(_traced, base, target, watched, part)
            ended = forked(task, base / "tree", base / "log", _TRACE, base / "numba")
            if not part.is_file():
                raise SystemExit(f"{target} could not be traced: {ended.status}\n{ended.output[-2000:]}")
        table = json.loads(part.read_text())
        for key in ("tests", "shared"):
            merged[key].update(table[key])
        merged["failed"] += table["failed"]
    return merged


def _traced(base: Path, target: str, watched: set[str], part: Path) -> int:
    import pytest

    plugin = Reach(f"{base / 'tree'}/", watched)
    status = pytest.main([target, "-p", "no:randomly"], plugins=[plugin])
    part.write_text(json.dumps(plugin.table()))
    return int(status)


def in_turns(mutants: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A sample such that no group waits until another is done."""
    counts = Counter(one["group"] for one in mutants)
    place: Counter[str] = Counter()
    turns = []
    for one in mutants:
        turns.append(place[one["group"]] * _ROUNDS // counts[one["group"]])
        place[one["group"]] += 1
    return [mutants[k] for k in sorted(range(len(mutants)), key=lambda k: turns[k])]


def judged(
    base: Path, mutant: dict[str, Any], selection: Selection, first: float, wide: bool = False
) -> dict[str, Any]:
    """Runs the tests on one mutant: which of them saw it, or that none did."""
    tree = base / "tree"
    path = tree / mutant["file"]
    source = path.read_bytes()
    cache = selection.cache_for(mutant, base)
    extra = 90.0 if mutant["file"].endswith("kernels.py") else 0.0
    tried = 0
    began = time.perf_counter()
    try:
        path.write_text(mutant["text"], "utf-8")
        for line, tests, seconds in selection.lines(mutant, first, _SECOND if wide else 0.0):
            if not tests:
                continue
            tried += len(tests)
            limit = 25.0 + extra + 4.0 * seconds
            ended = forked(partial(_tested, tests), tree, base / "log", limit, cache)
            if ended.status in (4, 5):  # the tests are not there: nothing was tried
                raise SystemExit(f"no test was collected:\n{ended.output[-1000:]}")
            if ended.status != 0:
                return {"outcome": "killed", "line": line, "by": _killer(ended.status, ended.output), "tests": tried,
                        "seconds": time.perf_counter() - began}  # fmt: skip
    finally:
        path.write_bytes(source)
        selection.forget(cache, base)
    return {"outcome": "survived", "line": 0, "by": "", "tests": tried, "seconds": time.perf_counter() - began}


def _tested(tests: list[str]) -> int:
    import pytest

    return int(pytest.main(["-x", "-q", "-rfE", "--durations=0", "--tb=line", "-p", "no:warnings", *tests]))


def _killer(status: int | None, output: str) -> str:
    if status is None:
        return "too slow"
    for text in output.splitlines():
        if text.startswith(("FAILED ", "ERROR ")):
            return text.split()[1].removeprefix("tests/")
    return f"status {status}"


def main() -> int:
    """Runs the sample; 1 if a survivor of it has no verdict yet."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", default="1", metavar="WORD", help="which sample")
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="groups whose name begins like one")
    parser.add_argument("--scale", type=float, default=1.0, metavar="X", help="times as many mutants")
    parser.add_argument("--trace", action="store_true", help="copy the tree and trace its tests anew")
    parser.add_argument("--page", action="store_true", help="write docs/studies/mutation.md from the table, and end")
    parser.add_argument("--wide", action="store_true", help="ask tests elsewhere, too")
    parser.add_argument("--again", action="store_true", help="run recorded survivors again that may not be equivalent")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="of tests per mutant, as traced")
    options = parser.parse_args()
    base, table = cache_base(), Table(ROOT / "docs/studies/mutation.csv")
    if options.page:
        write_tables(ROOT / "docs/studies/mutation.md", table.rows)
        return 0
    prepare(base, options.trace)
    preload()
    groups = [g for g in GROUPS if g.name.startswith(tuple(options.only))]
    selection = Selection(base / "tree")
    targets = sorted({t for g in GROUPS for t in g.tests}) + (selection.elsewhere() if options.wide else [])
    selection.learn(reached(base, targets, selection.watched()))
    for mutant in in_turns(drawn(base, options.seed, groups, options.scale)):
        if table.has(options.seed, mutant) != options.again or (options.again and not table.open(options.seed, mutant)):
            continue
        result = judged(base, mutant, selection, options.seconds, options.wide)
        table.add(options.seed, mutant, result)
        said = f"{mutant['file']}:{mutant['line']} {mutant['operator']}  {result['by']}"
        print(f"{mutant['group']:<18}{result['outcome']:<9}{result['seconds']:5.1f} s  {said}", flush=True)
    own = [row for row in table.rows if row["sample"] == options.seed and row["outcome"] == "survived"]
    return int(any(not row["verdict"] for row in own))


if __name__ == "__main__":
    sys.exit(main())
