"""A command of ours in a process of its own: what it reports is reported here, and whatever kills it is its own."""

from __future__ import annotations

import contextlib
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from ..core.errors import Cancelled
from ..core.files import parse_json
from ..core.progress import Progress

_RUN = Path(__file__).resolve().parents[1] / "run_dgs.py"
#: Seconds between two looks whether the user asked to stop.
_LOOK = 0.2
#: A longer line is no event of ours.
_LONGEST_LINE = 2**20


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        status: its exit status; negative for a signal that ended it.
        line: why, where it failed; '' where it did not.
        result: what it made, as its last event says.
    """

    status: int
    line: str = ""
    result: dict[str, Any] = field(default_factory=dict)


def run_child(arguments: Sequence[str], progress: Progress, folder: str | None = None) -> Ended:
    """Runs `run_dgs.py ARGUMENTS` and waits for its end; asks it to stop where the user asks us.

    It ends with this process, however that ends. Ctrl-C on a terminal comes to this process only.

    Args:
        folder: that relative paths in the arguments start from; this process's if not given.
    """
    command = [sys.executable, str(_RUN), *arguments, "--progress", "json", "--control"]
    with tempfile.TemporaryFile() as words:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=words,
                text=True,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
                cwd=folder,
            )
        except OSError as error:
            return Ended(2, f"A process for it cannot be started ({error.strerror}).")
        try:
            last = _follow(process, progress)
        finally:
            process.kill()  # nothing happens to one that has ended
            status = process.wait()
        if last.get("event") == "done":
            return Ended(status, "", last["result"] if isinstance(last.get("result"), dict) else {})
        words.seek(0)
        said = words.read().decode("utf-8", "replace").strip().splitlines() or [""]
        line = str(last.get("text", "")) or said[-1] or f"It ended with status {status}."
    if status < 0:
        line = f"It was ended by signal {-status}. {line}"
    return Ended(status if status else 1, " ".join(line.split()))


def _follow(process: subprocess.Popen[str], progress: Progress) -> dict[str, Any]:
    """Reports what the process says until it says no more; the event that it ended with."""
    lines: queue.Queue[str | None] = queue.Queue()
    assert process.stdin is not None and process.stdout is not None
    threading.Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
    last: dict[str, Any] = {}
    stopping = False
    while True:
        if not stopping and progress.cancelled():
            stopping = True
            with contextlib.suppress(OSError):  # it has just ended
                process.stdin.write("cancel\n")
                process.stdin.flush()
        try:
            line = lines.get(timeout=_LOOK)
        except queue.Empty:
            continue
        if line is None:
            process.wait()
            return last
        event = _event(line)
        if event.get("event") in ("done", "error"):
            last = event
        else:
            _report(event, progress)


def _read(stream: IO[str], lines: queue.Queue[str | None]) -> None:
    while line := stream.readline(_LONGEST_LINE):
        lines.put(line)
    lines.put(None)


def _event(line: str) -> dict[str, Any]:
    try:
        value = parse_json(line.encode("utf-8", "replace"))
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


def _report(event: dict[str, Any], progress: Progress) -> None:
    kind = event.get("event")
    if kind == "stage":
        total = event.get("total")
        progress.stage(str(event.get("name")), total if isinstance(total, int) else None)
    elif kind == "advance" and isinstance(event.get("done"), int):
        named = {name: value for name, value in event.items() if name not in ("done", "total", "seconds_left")}
        progress.advance(event["done"], **{n: float(v) for n, v in named.items() if isinstance(v, int | float)})
    elif kind == "note":
        progress.note(str(event.get("text")))


def was_stopped(ended: Ended) -> bool:
    """Whether it ended because it was asked to."""
    return ended.status == Cancelled.exit_code
