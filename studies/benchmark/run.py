"""`make benchmark`: makes the sets, runs the product on each, and writes docs/benchmark.md.

    python -m studies.benchmark [--quick] [--data FOLDER] [--only SCENE ...] [--presets draft balanced]
                                [--minutes 1 2 4 ...] [--again] [--page FILE]

Rendered sets are kept in benchmarks/data, rows and twins in benchmarks/runs/benchmark (--quick: all in
benchmarks/runs/benchmark_quick), all rows in benchmarks/benchmark.json; everything is taken up again. FOLDER has the
shared photo sets (lego, copr, ...); scenes whose set is not there are left out. --quick takes about two minutes and
proves that everything runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.devices import choose_device
from ...core.files import make_folder, read_json, write_json, write_text
from ...core.machine import cores, machine
from ..comparison.commands import Failed, Run, checked
from .page import cell, kept_by_hand, page
from .pictures import write_picture
from .runs import ROOT, Bench, Effort, Row, minutes, preset
from .scenes import QUICK, SCENES, BenchmarkScene, RenderedSet
from .sets import PreparedSet, prepared

#: Where shared photo sets usually are: beside the clone.
SHARED = ROOT.parent / "shared" / "data"


@dataclass(frozen=True)
class Places:
    """Folders and files of a benchmark.

    Attributes:
        sets: what is rendered; runs: rows and twins; content: all rows; page: what is written.
    """

    sets: Path
    runs: Path
    content: Path
    page: Path

    @staticmethod
    def of(quick: bool, out: Path | None, page: Path | None) -> Places:
        """The usual ones, unless others were named."""
        runs = out or ROOT / "benchmarks" / "runs" / ("benchmark_quick" if quick else "benchmark")
        if quick:
            return Places(runs / "data", runs, runs / "benchmark.json", page or runs / "benchmark.md")
        benchmarks = ROOT / "benchmarks"
        return Places(benchmarks / "data", runs, benchmarks / "benchmark.json", page or ROOT / "docs" / "benchmark.md")


def measure(
    scenes: Sequence[BenchmarkScene], efforts: Sequence[Effort], bench: Bench, run: Run, places: Places, shared: Path
) -> list[str]:
    """Runs what is missing; returns the names of scenes whose set is not there.

    Raises:
        Failed: a command failed or was stopped.
    """
    missing, command = [], checked(run)
    for scene in scenes:
        data = prepared(scene, command, places.sets, shared)
        if data is None:
            missing.append(scene.name)
            continue
        for effort in efforts:
            row = bench.row(scene, effort, data)
            print(f"{scene.name}, {effort.name}: {row['failed'] or cell(row)}", flush=True)
            if not row["failed"] and isinstance(scene.source, RenderedSet):
                _picture(scene, row, data, bench, places)
    return missing


def _picture(scene: BenchmarkScene, row: Row, data: PreparedSet, bench: Bench, places: Places) -> None:
    """Beside the page, of the last effort that ran."""
    write_picture(row, data, bench.twin(scene.name, row["effort"]), _picture_file(scene.name, places))


def _picture_file(scene: str, places: Places) -> Path:
    return places.page.parent / "images" / "benchmark" / f"{scene}.jpg"


def write(scenes: Sequence[BenchmarkScene], missing: list[str], bench: Bench, quick: bool, places: Places) -> None:
    """benchmark.json and the page, from all rows that are there, and those of the page so far."""
    found = bench.rows([scene.name for scene in scenes], _published(places.content))
    efforts = _ordered({row["effort"] for row in found})
    rows = [row for effort in efforts for row in found if row["effort"] == effort]
    content: dict[str, Any] = {
        "quick": quick,
        "machine": machine(bench.threads or cores(), choose_device("auto")),
        "efforts": efforts,
        "missing": missing,
        "pictures": _pictures(rows, places),
        "rows": rows,
    }
    write_json(places.content, content)
    before = places.page.read_text("utf-8") if places.page.is_file() else ""
    make_folder(places.page.parent)
    write_text(places.page, page(content, scenes, kept_by_hand(before)))
    print(f"wrote {places.page.relative_to(ROOT) if places.page.is_relative_to(ROOT) else places.page}")


def _published(content: Path) -> list[Row]:
    """Rows of the page so far."""
    rows: list[Row] = read_json(content)["rows"] if content.is_file() else []
    return rows


def _ordered(efforts: set[str]) -> list[str]:
    """Presets as they grow, then time limits."""
    presets = [name for name in ("draft", "balanced", "fine", "best") if name in efforts]
    return presets + sorted(efforts - set(presets), key=lambda name: float(name.split()[0]))


def _pictures(rows: Sequence[Row], places: Places) -> list[tuple[str, str, str]]:
    """(scene, words, link) of the pictures that are there."""
    found = []
    for name in dict.fromkeys(row["scene"] for row in rows):
        last = [row for row in rows if row["scene"] == name and not row["failed"]]
        file = _picture_file(name, places)
        if last and file.is_file():
            words = f"{last[-1]['effort']}: {last[-1]['worst']['psnr']:.1f} dB, the mean being {last[-1]['psnr']:.1f}"
            found.append((name, words, str(file.relative_to(places.page.parent))))
    return found


def main(run: Run) -> int:
    """Reads the arguments of this process; `run` runs our own commands."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.benchmark", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--data", type=Path, default=SHARED, metavar="FOLDER", help="of the shared photo sets")
    parser.add_argument("--only", nargs="+", default=[], metavar="SCENE", choices=[scene.name for scene in SCENES])
    parser.add_argument("--presets", nargs="*", choices=("draft", "balanced", "fine", "best"))
    parser.add_argument("--minutes", type=float, nargs="+", default=[], metavar="N", help="time limits")
    parser.add_argument("--again", action="store_true", help="run rows of an earlier state of the engine anew")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="of rows and twins, instead of the usual one")
    parser.add_argument("--page", type=Path, metavar="FILE", help="docs/benchmark.md if not given")
    options = parser.parse_args()
    scenes = QUICK if options.quick else SCENES
    presets = options.presets if options.presets is not None else ["draft"] if options.quick else ["draft", "balanced"]
    efforts = [*map(preset, presets), *map(minutes, sorted(options.minutes))]
    out, to = (None if given is None else given.resolve() for given in (options.out, options.page))
    places = Places.of(options.quick, out, to)
    bench = Bench(places.runs, options.threads, options.again)
    wanted = [scene for scene in scenes if not options.only or scene.name in options.only]
    try:
        missing = measure(wanted, efforts, bench, run, places, options.data)
    except Failed as stop:
        return int(stop.args[0])
    write(scenes, missing, bench, options.quick, places)
    return 0
