"""`stress`: every hard case on this machine and device, one line each."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.devices import BackendName, choose_device
from ..core.errors import Cancelled, DgsError
from ..core.outputs import check_outputs, note_output
from .arguments import add_machine, add_overwrite, show_defaults, whole
from .progress_choice import Reporting

if TYPE_CHECKING:
    from ..studies.stability.case import Result
    from ..studies.stability.torture import TortureResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Runs every known hard case (poison, needles, giants, ties, wide blurs, rails, damaged files) "
        "on this machine and device; a line each with its error and what is allowed. Ends with 2 if one fails."
    )
    show_defaults(parser)
    add = parser.add_argument
    add(
        "--only",
        action="append",
        default=[],
        metavar="WORD",
        help="cases whose family or name holds this word; may be repeated",
    )
    add(
        "--fuzz",
        type=whole(0),
        metavar="N",
        default=None,
        help="random scenes of anything at all (100000 takes minutes); 500 with the table, if not given",
    )
    add("--torture", action="store_true", help="20 trainings on deliberately bad scenes instead of the table")
    add(
        "--fuzz-files",
        type=whole(1),
        metavar="N",
        help="instead: N damaged files for every reader; no traceback, no abort, no hang (10000 take an hour)",
    )
    add(
        "--record",
        type=Path,
        metavar="FILE",
        help="with --fuzz-files: keeps what came of each reader, and goes on from there when it is started again",
    )
    add("--json", action="store_true", help="one JSON object instead of lines")
    add("--markdown", type=Path, metavar="FILE", help="also write the tables to this document")
    add("--list", action="store_true", help="name the cases, and run none")
    add_overwrite(parser)
    add_machine(parser)


def stress_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs what was asked for; 2 if anything failed."""
    if options.fuzz_files is not None:
        return _damaged_files(options, progress)
    from ..core.machine import machine, use_machine  # late: slows --help
    from ..studies.stability import table  # heavy: torch
    from ..studies.stability.case import backends_for  # heavy: torch
    from ..studies.stability.fuzz import fuzz  # heavy: torch
    from ..studies.stability.registry import all_cases  # heavy: torch

    threads, device = use_machine(options.threads), choose_device(options.device)
    cases = [
        c
        for c in all_cases()
        if not options.only or any(w.lower() in f"{c.family} {c.name}".lower() for w in options.only)
    ]
    if not cases:
        families = ", ".join(sorted({c.family for c in all_cases()}))
        raise DgsError(f"No case is called '{' or '.join(options.only)}'", f"See --list; families are {families}")
    if options.markdown is not None and not table.takes_tables(options.markdown):
        check_outputs([options.markdown], overwrite=options.overwrite)
    if options.list:
        for one in cases:
            print(f"{one.family:<11}{one.name}: {one.states}")
        return 0
    say = (lambda text: None) if options.json else (lambda text: print(text, flush=True))
    began = time.perf_counter()
    only_extra = options.torture or options.fuzz is not None
    backends = backends_for(device)
    results = [] if only_extra and options.markdown is None else _table(cases, backends, say, progress)
    found = None
    if options.fuzz is not None or not (options.torture or options.only):
        found = fuzz(500 if options.fuzz is None else options.fuzz, device, report=lambda done: _look(progress))
        say(table.fuzz_line(found))
    outcomes = _torture(table.torture_line, say, progress) if options.torture else []
    seconds, here = time.perf_counter() - began, machine(threads, device)
    failed = table.failures(results, found, outcomes)
    if options.json:
        json.dump(table.as_json(results, found, outcomes, here, seconds), sys.stdout, indent=1)
        print()
    if options.markdown is not None:
        table.write_markdown(options.markdown, table.markdown(results, found, outcomes, here, seconds))
        note_output(options.markdown)
    count = len(results) + len(outcomes) + (found is not None)
    say(f"{count - failed} of {count} hold, {failed} failed; {seconds:.0f} s on {table.described(here)}")
    return 2 if failed else 0


def _damaged_files(options: argparse.Namespace, progress: Reporting) -> int:
    from .fuzz_files import FuzzFiles, check_document, fuzz_files, write_document  # heavy: torch

    if options.markdown is not None:
        check_document(options.markdown, options.overwrite)
    asked = FuzzFiles(options.fuzz_files, options.only, options.record)
    results = fuzz_files(asked, lambda text: print(text, flush=True), progress.cancelled)
    _look(progress)
    if options.markdown is not None:
        write_document(options.markdown, results, options.threads)
    faulty = sum(one.faults > 0 for one in results)
    print(f"{len(results) - faulty} of {len(results)} readers hold, {faulty} failed", flush=True)
    return 2 if faulty else 0


def _table(cases, backends: tuple[BackendName, ...], say, progress: Reporting) -> list[Result]:  # type: ignore[no-untyped-def]
    from ..studies.stability import table  # heavy: torch
    from ..studies.stability.case import measured, runs  # heavy: torch

    results = []
    say(table.heading())
    for one, backend in runs(cases, backends):
        _look(progress)
        results.append(measured(one, backend))
        say(table.line(results[-1]))
    return results


def _torture(line, say, progress: Reporting) -> list[TortureResult]:  # type: ignore[no-untyped-def]
    from ..studies.stability.torture import tortured, tortures  # heavy: torch

    outcomes = []
    for one in tortures():
        _look(progress)
        outcomes.append(tortured(one))
        say(line(outcomes[-1]))
    return outcomes


def _look(progress: Reporting) -> None:
    if progress.cancelled():
        raise Cancelled("Stopped before all cases were measured")
