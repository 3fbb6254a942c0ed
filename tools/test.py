#!/usr/bin/env python3
"""Runs all tests, several files side by side, and sums up.

    .venv/bin/python tools/test.py [--jobs N] [pytest arguments]

Files of one folder share a process, as each spends seconds on its imports. As many processes at a time as there are
cores. What failed is printed whole, the rest in a line each. A process that hangs is
ended, says what each of its threads was at, and is begun anew, once. The last line is the sum of all: `N passed, N
failed, N skipped`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Longest first, in this order, so that no long one is left alone at the end.
LONG = (
    *("tests/command_line", "tests/blender/test_", "tests/core/training", "tests/core/inspection", "tests/blender/job"),
    *("tests/core/pipeline", "tests/hard_cases", "tests/core/measure", "tests/blender", "tests/studies/comparison"),
    *("tests/core/test_", "tests/core/backends", "tests/core/surface", "tests/core/twin"),
)
#: pytest's status where no test was selected.
NOTHING_SELECTED = 5
#: Seconds that a process may take: three times those of the longest one on two cores. The limit of pytest for a test
#: raises in the main thread, which does not end one that waits for a stuck thread.
LIMIT = 900.0
#: Seconds that a process may take to say what each of its threads was at.
LAST_WORDS = 20.0


@dataclass(frozen=True)
class Ran:
    """One process of pytest.

    Attributes:
        target: what it ran.
        passed, failed, skipped: tests.
        status: of the process.
        seconds: wall time.
        output: all it printed.
        hung: it had to be ended.
    """

    target: str
    passed: int
    failed: int
    skipped: int
    status: int
    seconds: float
    output: str
    hung: bool = False

    @property
    def fine(self) -> bool:
        """Whether nothing failed (no test selected is fine)."""
        return self.status in (0, NOTHING_SELECTED) and not self.failed


def targets() -> list[str]:
    """What to run, the longest first."""
    found = {file.parent.relative_to(ROOT).as_posix() for file in (ROOT / "tests").rglob("test_*.py")}
    # (pytest goes into the folders of a folder, whose tests would run twice)
    return sorted(
        (f"{name}/test_*.py" if any(other.startswith(f"{name}/") for other in found) else name for name in found),
        key=lambda name: (rank(name), name),
    )


def rank(target: str) -> int:
    """Its place in `LONG`, or behind all of them."""
    return next((place for place, name in enumerate(LONG) if target.startswith(name)), len(LONG))


def run(target: str, arguments: list[str]) -> list[Ran]:
    """Runs pytest on `target` in a process of its own; once more if that hangs."""
    first = attempt(target, arguments)
    return [first, attempt(target, arguments)] if first.hung else [first]


def attempt(target: str, arguments: list[str], limit: float = LIMIT) -> Ran:
    """Runs pytest on `target`, for `limit` seconds at most."""
    environment = {**os.environ, "OMP_WAIT_POLICY": "passive"}
    # (Without bytecode on disk each of the hundreds of processes that tests start compiles the project anew: 0.3 s.)
    for name in ("BLENDER_USER_RESOURCES", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE"):
        environment.pop(name, None)
    files = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob(target)) if "*" in target else [target]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+", errors="replace") as said:
        results = Path(folder) / "results.xml"
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", f"--junitxml={results}", *files, *arguments],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,  # (a pipe would be held open by what a hung process leaves behind)
            stderr=subprocess.STDOUT,
        )
        hung = not ends(process, limit)
        passed, failed, skipped = counts(results)
        said.seek(0)
        output = said.read()
    broken = hung or process.returncode not in (0, 1, NOTHING_SELECTED)  # ended early: a crash counts as a failed test
    return Ran(target, passed, failed + broken, skipped, process.returncode, time.perf_counter() - began, output, hung)


def ends(process: subprocess.Popen[bytes], limit: float) -> bool:
    """Waits for a process for `limit` seconds, then has it say what its threads are at (pytest's fault handler), and
    ends it; False if that was needed."""
    try:
        process.wait(limit)
        return True
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)
    try:
        process.wait(LAST_WORDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    return False


def counts(results: Path) -> tuple[int, int, int]:
    """Passed, failed and skipped tests of a JUnit file; none if it was not written."""
    if not results.is_file():
        return 0, 0, 0
    suites = ElementTree.parse(results).getroot().iter("testsuite")
    total = failed = skipped = 0
    for suite in suites:
        total += int(suite.get("tests", 0))
        failed += int(suite.get("failures", 0)) + int(suite.get("errors", 0))
        skipped += int(suite.get("skipped", 0))
    return total - failed - skipped, failed, skipped


def report(ran: Ran) -> None:
    """Prints a line, and all that was said where something failed."""
    if ran.status == NOTHING_SELECTED:
        return
    sums = f"{ran.passed} passed, {ran.failed} failed, {ran.skipped} skipped"
    print(f"{ran.target:52s} {sums} {ran.seconds:.0f} s" + (", hung" if ran.hung else ""), flush=True)
    if not ran.fine:
        print(ran.output, flush=True)


def main() -> int:
    """Runs everything; 1 if anything failed or nothing ran."""
    arguments, jobs = sys.argv[1:], len(os.sched_getaffinity(0))
    if arguments[:1] == ["--jobs"]:
        jobs, arguments = int(arguments[1]), arguments[2:]
    began, last, hung = time.perf_counter(), [], []
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        for attempts in pool.map(lambda target: run(target, arguments), targets()):
            for ran in attempts:
                report(ran)
            last.append(attempts[-1])
            hung += attempts[:-1]
    passed, failed, skipped = (sum(getattr(ran, name) for ran in last) for name in ("passed", "failed", "skipped"))
    broken = [ran.target for ran in last if not ran.fine]
    if hung:
        print("Hung, and begun anew: " + ", ".join(ran.target for ran in hung))
    if broken:
        print("Failed: " + ", ".join(broken))
    print(f"All tests took {time.perf_counter() - began:.0f} s")
    print(f"{passed} passed, {failed} failed, {skipped} skipped", flush=True)
    return int(bool(broken) or not passed)


if __name__ == "__main__":
    sys.exit(main())
