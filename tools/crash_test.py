#!/usr/bin/env python3
"""Pulls the plug at every step of every command: the folder must hold what was there before, or what came after.

    .venv/bin/python -m tools.crash_test [--only WORD] [--every N] [--kills N] [--work FOLDER] [--table FILE]

Three parts, on the tiny set of tests/crash_commands.py. *Injected failures*: a command runs in a forked process, and at
its n-th call that changes files (open, write, fsync, rename, link, unlink, mkdir, ...; native code's calls, too) it is
killed by signal 9, in the middle of the write if it is one; or that call and all later ones that need room fail with
ENOSPC. Every n is tried. *Small disks*: the folder is a real disk with n pages of room, for every n. *Kills* come
from outside: forked runs at random moments of their training, and commands that are run as users run them, half of
these while they put their files in place.

After each, the folder is opened as the program opens it, and every file's digest is compared. Then a sample is asked
for again (or resumed) and must end as a run that nothing disturbed. Status 0: nothing was lost or mixed. What was done
is kept in the work folder: a campaign that was cut off goes on, and several processes may share one. The table gets a
row for each command and fault.
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
    from dgs.tests.crash_commands import Stage
    from dgs.tests.crash_trials import FaultResult, Trials

ROOT = Path(__file__).resolve().parent.parent
SOURCE, TABLE = ROOT / "tools" / "file_faults.c", ROOT / "docs" / "studies" / "crashes.csv"
#: Every how many-th failure the command is asked for again.
AGAIN = 7
#: Kills that wait for the training to begin, as a share of all.
TRAINING = 0.6
#: Latest moment of a kill behind the first file that is put in place, in seconds.
LATEST_PLACING = 0.05
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


def every_step(name: str, make: Callable[[], Trials], journal: Journal, stride: int, disks: bool) -> None:
    """Kills and starves a command at its n-th change, for every n, until there is none; then small disks."""
    trials = cache(make)  # (not made where all of it was done before)
    ways: dict[str, Callable[[int], FaultResult]] = {
        "kill": lambda at: trials().at("kill", at, at % AGAIN == 0),
        "full": lambda at: trials().at("full", at, at % AGAIN == 0),
        "disk": lambda at: trials().on_disk_of(at, at % AGAIN == 0),
    }
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

    cases = {case.name: case for case in CASES if case.work is None}
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


def write_table(path: Path, rows: list[Row]) -> None:
    """The sums as CSV."""
    table = list(summed(rows))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


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
        "--only", default="", metavar="WORD", help="of a command's name, or of 'SIGKILL, training' or 'SIGKILL, others'"
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th step")
    parser.add_argument("--kills", type=int, default=64, metavar="N", help="real processes that are killed")
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
                every_step(case.name, lambda case=case: Trials(stage, case), journal, options.every, disks)  # type: ignore[misc]
                print(f"{time.monotonic() - began:6.0f} s  {case.name}", flush=True)
        kills(options.kills, options.only, journal, stage)
    journal = Journal(work / "journal.jsonl")
    rows = [row for row in journal.rows if row.found != "done"]
    write_table(options.table, journal.rows)
    faults = Counter(row.fault.partition(",")[0] for row in rows)
    broken = sum(row.found == "BROKEN" for row in rows)
    print(
        f"{faults['kill']} injected kills, {faults['full']} injected full disks, {faults['disk']} small disks, "
        f"{faults['SIGKILL']} real kills: {broken} lost or mixed; {sum(row.again for row in rows)} asked again"
    )
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
