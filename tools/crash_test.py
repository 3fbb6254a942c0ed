#!/usr/bin/env python3
"""Pulls the plug at every step of every command: the folder must hold what was there before, or what came after.

    .venv/bin/python -m tools.crash_test [--only WORD] [--every N] [--kills N] [--work FOLDER] [--table FILE]

Three parts, on the tiny set of tests/crash_commands.py. *Injected failures*: a command runs in a forked process, and at
its n-th call that changes files (open, write, fsync, rename, link, unlink, mkdir, ...; native code's calls, too) it is
killed by signal 9, in the middle of the write if it is one; or that call and all later ones that need room fail with
ENOSPC. Every n is tried. *Small disks*: the folder is a real disk with n pages of room, for every n. *Kills* come
from outside: forked runs at random moments of their training, and commands that are run as users run them, half of
these while they put their files in place. Where a child process looks for cameras by structure from motion, its own
calls fail, too, and it alone or its parent alone is killed at random moments.

After each, the folder is opened as the program opens it, and every file's digest is compared. Then a sample is asked
for again (or resumed) and must end as a run that nothing disturbed. Status 0: nothing was lost or mixed. What was done
is kept in the work folder: a campaign that was cut off goes on, and several processes may share one. The table gets a
row for each command and fault beside those of earlier campaigns, docs/reliability.md their sums.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dgs.tests.crash_commands import Case, Stage
    from dgs.tests.crash_trials import FaultResult, Trials

ROOT = Path(__file__).resolve().parent.parent
SOURCE, TABLE = ROOT / "tools" / "file_faults.c", ROOT / "docs" / "studies" / "crashes.csv"
PAGE = ROOT / "docs" / "reliability.md"
#: Every how many-th failure the command is asked for again.
AGAIN = 7
#: Kills that wait for the training to begin, as a share of all.
TRAINING = 0.6
#: Of a command whose child looks for cameras, every how many-th of the child's changes fails, and pages by which small
#: disks grow: it writes ten times as much as all else.
SEARCH_STEPS, SEARCH_PAGES = 10, 64
#: Latest moment of a kill behind the first file that is put in place, in seconds.
LATEST_PLACING = 0.05
#: Rows of the page, and their faults in the journal.
KINDS = {
    "injected kills": ("kill",),
    "injected full disks": ("full",),
    "small disks": ("disk",),
    "injected kills of the process that looks for cameras": ("kill, in the search",),
    "injected full disks of that process": ("full, in the search",),
    "real kills in training": ("SIGKILL, training",),
    "real kills at other moments": ("SIGKILL, placing", "SIGKILL, any moment"),
    "real kills of the process that looks for cameras": ("SIGKILL, child of the search",),
    "real kills of its parent meanwhile": ("SIGKILL, parent in the search",),
}
#: Columns of that table.
COLUMNS = ("failures", "as before", "as after", "lost or mixed")
#: Part of a command's time in which its child looks for cameras.
SEARCHING = 0.7
#: What the program writes first when it puts files in their place.
PLACING = (".change-next", ".change-commit")


@dataclass(frozen=True)
class Row:
    """One failure, as a line of the journal."""

    command: str
    fault: str
    at: int
    found: str
    why: str = ""
    again: bool = False


class Journal:
    """What was done so far, in a file of JSON lines."""

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text("utf-8").splitlines() if path.is_file() else []
        self.rows = [Row(**json.loads(line)) for line in lines]
        self._done = {(row.command, row.fault, row.at): row for row in self.rows}

    def find(self, command: str, fault: str, at: int, look: Callable[[], FaultResult]) -> Row:
        """The row of a failure that was tried before; else it is tried now."""
        if (command, fault, at) not in self._done:
            found = look()
            row = Row(command, fault, at, found.found, found.why, found.again)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")
            self.rows.append(row)
            self._done[command, fault, at] = row
            if found.found == "BROKEN":
                print(f"  BROKEN: {command}, {fault} {at}: {found.why[:1000]}", flush=True)
        return self._done[command, fault, at]


def every_step(case: Case, make: Callable[[], Trials], journal: Journal, stride: int, disks: bool) -> None:
    """Kills and starves a command at its n-th change, for every n, until there is none; then small disks."""
    trials, name = cache(make), case.name  # (not made where all of it was done before)
    pages = SEARCH_PAGES if case.search else 1
    ways: dict[str, Callable[[int], FaultResult]] = {
        "kill": lambda at: trials().at("kill", at, at % AGAIN == 0),
        "full": lambda at: trials().at("full", at, at % AGAIN == 0),
        "disk": lambda at: trials().on_disk_of(at * pages, at % AGAIN == 0),
    }
    if case.search:
        ways["kill, in the search"] = lambda at: trials().child_at("kill", SEARCH_STEPS * at, at % AGAIN == 0)
        ways["full, in the search"] = lambda at: trials().child_at("full", SEARCH_STEPS * at, at % AGAIN == 0)
    for fault, look in ways.items():
        if fault == "disk" and not disks:
            continue
        at, broken = 1, 0
        while (row := journal.find(name, fault, at, lambda at=at, look=look: look(at))).found != "done":  # type: ignore[misc]
            at += stride
            broken += row.found == "BROKEN"
            if broken >= 40:
                print(f"  {name}, {fault}: broken so often that the rest is left out", flush=True)
                break


def kill_a_training(trials: Trials, draw: random.Random, seconds: float, again: bool) -> FaultResult:
    """Kills a forked process from outside at a random moment of its training, and of what follows it."""

    def kill(process: int, began: int) -> None:
        os.read(began, 1)
        time.sleep(draw.uniform(0.0, seconds))
        os.kill(process, signal.SIGKILL)

    return trials.killed_in_training(kill, again)


def killer(moment: str, folder: Path, draw: random.Random, seconds: float) -> Callable[[list[str]], int]:
    """What starts a command as a user does, and kills it: 'placing' while files are put in place, else anywhere."""

    def kill(words: list[str]) -> int:
        process = subprocess.Popen(
            [sys.executable, str(ROOT / "run_dgs.py"), *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={name: value for name, value in os.environ.items() if name != "LD_PRELOAD"},
        )
        began, wait = time.monotonic(), draw.uniform(0.0, seconds)
        if moment == "placing":
            while process.poll() is None and not any((folder / name).exists() for name in PLACING):
                time.sleep(0.0005)
            began, wait = time.monotonic(), draw.uniform(0.0, LATEST_PLACING)
        while process.poll() is None and time.monotonic() - began < wait:
            time.sleep(0.0005)
        process.send_signal(signal.SIGKILL)
        return process.wait()

    return kill


def kills(count: int, only: str, journal: Journal, stage: Stage) -> None:
    """Kills processes at random moments from outside."""
    from dgs.tests.crash_commands import CASES
    from dgs.tests.crash_trials import Trials

    cases = {case.name: case for case in CASES if case.work is None and not case.search}
    training = [name for name in cases if name.startswith(("reconstruct", "resume"))]
    others = [name for name in cases if not name.startswith("resume")]
    known: dict[tuple[str, bool], tuple[Trials, float]] = {}
    for number in range(count):
        draw, trained = random.Random(number), number < TRAINING * count
        name = training[number % len(training)] if trained else others[number % len(others)]
        moment = "training" if trained else draw.choice(("placing", "any moment"))
        if only not in f"SIGKILL, {'training' if trained else 'others'}":
            continue

        def look(name=name, trained=trained, moment=moment, draw=draw, number=number) -> FaultResult:  # type: ignore[no-untyped-def]
            again = number % AGAIN == 0
            if (name, trained) not in known:
                began = time.monotonic()
                known[name, trained] = (
                    Trials(stage, replace(cases[name], process=not trained)),
                    time.monotonic() - began,
                )
            trials, seconds = known[name, trained]
            if trained:
                return kill_a_training(trials, draw, 0.3 * seconds, again)
            found = trials.killed_from_outside(killer(moment, stage.folder, draw, seconds), again)
            return replace(found, found="after") if found.found == "done" else found

        journal.find(name, f"SIGKILL, {moment}", number, look)


def searches(count: int, only: str, journal: Journal, stage: Stage) -> None:
    """Kills a child that looks for cameras, or its parent, at random moments of the search."""
    from dgs.tests.crash_commands import CASES
    from dgs.tests.crash_trials import Trials

    cases = [case for case in CASES if case.search]
    trials = {case.name: cache(lambda case=case: Trials(stage, case)) for case in cases}
    if only not in "SIGKILL, search":
        return
    for number in range(count):
        draw, case, parent = random.Random(number), cases[number // 2 % len(cases)], bool(number % 2)

        def look(case=case, parent=parent, draw=draw, number=number) -> FaultResult:  # type: ignore[no-untyped-def]
            one = trials[case.name]()
            seconds = draw.uniform(0.0, SEARCHING * one.seconds)
            return one.killed_in_search(lambda: time.sleep(seconds), parent, number % AGAIN == 0)

        journal.find(case.name, f"SIGKILL, {'parent in the' if parent else 'child of the'} search", number, look)


def summed(rows: list[Row]) -> Iterator[dict[str, object]]:
    """A row of the table for each command and fault."""
    keys = list(dict.fromkeys((row.command, row.fault) for row in rows))
    for command, fault in keys:
        found = [row for row in rows if (row.command, row.fault) == (command, fault) and row.found != "done"]
        count = Counter(row.found for row in found)
        yield {
            "command": command,
            "fault": fault,
            "failures": len(found),
            "as before": count["before"],
            "as after": count["after"],
            "lost or mixed": count["BROKEN"],
            "asked again": sum(row.again for row in found),
        }


def table_of(path: Path, rows: list[Row]) -> list[dict[str, object]]:
    """The sums, and those of the file that are of other commands and faults."""
    old: dict[tuple[object, object], dict[str, object]] = {}
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            for kept in csv.DictReader(file):
                numbers = {name: int(value) for name, value in kept.items() if name not in ("command", "fault")}
                old[kept["command"], kept["fault"]] = {**kept, **numbers}
    return list({**old, **{(row["command"], row["fault"]): row for row in summed(rows)}}.values())


def write_table(path: Path, table: list[dict[str, object]]) -> None:
    """The sums as CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


def figures(table: list[dict[str, object]]) -> str:
    """The sums of all commands, for docs/reliability.md."""
    lines = ["| failure | tried | as before | as after | lost or mixed |", "|---|---|---|---|---|"]
    for words, faults in KINDS.items():
        sums = [summed_up([row for row in table if row["fault"] in faults], name) for name in COLUMNS]
        lines.append(f"| {words} | {' | '.join(map(str, sums))} |")
    again = summed_up(table, "asked again")
    return "\n".join(lines) + (
        f"\n\n{again} times the command was asked for again and ended in the right state. "
        "By command: [studies/crashes.csv](studies/crashes.csv)."
    )


def summed_up(table: list[dict[str, object]], column: str) -> int:
    """A column's sum."""
    return sum(int(str(row[column])) for row in table)


def write_page(path: Path, table: list[dict[str, object]]) -> None:
    """Puts the figures in their place."""
    before, first, rest = path.read_text("utf-8").partition("<!-- figures -->\n")
    _, last, after = rest.partition("\n<!-- /figures -->")
    path.write_text(before + first + figures(table) + last + after, "utf-8")


def with_faults(work: Path) -> None:
    """Starts this program anew with tools/file_faults.c before the C library, where there is a compiler."""
    compiler = shutil.which("cc")
    if hasattr(ctypes.CDLL(None), "faults_arm") or compiler is None:
        return
    library, made = work / "file_faults.so", work / f"{os.getpid()}.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(made), str(SOURCE), "-ldl"], check=True)
    made.rename(library)
    environment = {**os.environ, "LD_PRELOAD": str(library), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    os.execve(sys.executable, [sys.executable, "-m", "tools.crash_test", *sys.argv[1:]], environment)


def main() -> int:
    """0 if nothing was lost or mixed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--only", default="", metavar="WORD", help="of a command's name, or 'training', 'others' or 'search' (kills)"
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th step")
    parser.add_argument("--kills", type=int, default=64, metavar="N", help="real processes that are killed")
    parser.add_argument("--searches", type=int, default=48, metavar="N", help="searches for cameras that are killed")
    parser.add_argument("--work", type=Path, help="folder that keeps what was done; in memory it is much quicker")
    parser.add_argument("--table", type=Path, default=TABLE, help="CSV with the sums")
    options = parser.parse_args()
    shared = Path("/dev/shm")
    work = options.work or (shared if shared.is_dir() else Path(tempfile.gettempdir())) / "dgs-crash-test"
    work.mkdir(parents=True, exist_ok=True)
    with_faults(work)
    sys.path.insert(0, str(ROOT))
    import run_dgs

    run_dgs.mount_package()
    from dgs.tests.crash_commands import CASES, Stage, warm_up
    from dgs.tests.crash_trials import Trials
    from dgs.tests.crashes import can_mount

    warm_up()
    journal, began, disks = Journal(work / "journal.jsonl"), time.monotonic(), can_mount()
    with tempfile.TemporaryDirectory(prefix="stage-", dir=work) as folder:
        stage = Stage(Path(folder) / "stage")
        for case in CASES:
            if options.only in case.name:
                every_step(case, lambda case=case: Trials(stage, case), journal, options.every, disks)  # type: ignore[misc]
                print(f"{time.monotonic() - began:6.0f} s  {case.name}", flush=True)
        kills(options.kills, options.only, journal, stage)
        searches(options.searches, options.only, journal, stage)
    journal = Journal(work / "journal.jsonl")
    rows = [row for row in journal.rows if row.found != "done"]
    table = table_of(options.table, journal.rows)
    write_table(options.table, table)
    if options.table == TABLE:
        write_page(PAGE, table)
    faults = Counter(row.fault.partition(",")[0] for row in rows)
    broken = sum(row.found == "BROKEN" for row in rows)
    print(
        f"{faults['kill']} injected kills, {faults['full']} injected full disks, {faults['disk']} small disks, "
        f"{faults['SIGKILL']} real kills: {broken} lost or mixed; {sum(row.again for row in rows)} asked again"
    )
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
