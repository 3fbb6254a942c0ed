"""The engine's process and the thread that reads it. Knows no Blender.

Events come out of `Worker.events`, a queue; orders go in as lines. The process ends with us, however
we end: its standard input closes, and on Linux the kernel kills it with the thread that started it.
"""

from __future__ import annotations

import contextlib
import queue
import subprocess
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ...core.files import parse_json
from ..engine.process import broken_pipes_are_errors, creation_flags, environment

#: A log that grows beyond this is begun anew (bytes).
_LARGEST_LOG = 4_000_000
#: A line that is longer is read in pieces, none of which is an event.
_LONGEST_LINE = 2**20


@dataclass(frozen=True)
class Ended:
    """The process has ended; a negative status is the signal that ended it."""

    status: int


@dataclass(frozen=True)
class Extra:
    """What `after_event` has read."""

    value: Any


Message = dict[str, Any] | Ended | Extra


class Worker:
    """One process of the engine.

    Args:
        command: program and arguments; it writes one JSON object a line.
        log: file that its output goes to; appended.
        after_event: called on the reading thread after every event; what it returns, unless None, comes out
            of `events` as `Extra`. For reading files where no window waits.
        on_start: called with the process's number on the reading thread, as soon as it has one.
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        after_event: Callable[[], Any] | None = None,
        on_start: Callable[[int], None] | None = None,
    ) -> None:
        self.events: queue.Queue[Message] = queue.Queue()
        self.pid: int | None = None
        self._command, self._log = list(command), log
        self._after_event, self._on_start = after_event, on_start
        self._process: subprocess.Popen[str] | None = None
        self._orders: list[str] = []
        self._lock = threading.Lock()
        # A daemon: Blender must be able to quit while it works.
        self._thread = threading.Thread(target=self._run, name="descatter-worker", daemon=True)

    def start(self) -> None:
        """Returns at once; the process is started on the reading thread, with which it would die."""
        self._thread.start()

    def send(self, order: str) -> None:
        """Sends 'cancel', 'pause' or 'continue'; kept until the process can hear it."""
        with self._lock:
            if self._process is None:
                self._orders.append(order)
            else:
                _write(self._process.stdin, order)

    def kill(self) -> None:
        """Ends the process now; its last checkpoint stays."""
        with self._lock:
            if self._process is not None:
                self._process.kill()

    def join(self, seconds: float) -> bool:
        """Waits for the end; False if it did not come in time."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        status = 2
        try:
            with broken_pipes_are_errors():
                status = self._converse()
        except OSError as error:
            text = f"The engine cannot be started ({error}). Check its Python in the add-on's preferences."
            self.events.put({"event": "error", "text": text, "status": 2})
        finally:
            self.events.put(Ended(status))

    def _converse(self) -> int:
        with open(self._log, _log_mode(self._log), encoding="utf-8", errors="replace") as log:
            log.write(f"$ {' '.join(self._command)}\n")
            log.flush()
            with subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                encoding="utf-8",
                errors="replace",
                env=environment(),
                creationflags=creation_flags(),
            ) as process:
                self._began(process)
                assert process.stdout is not None
                while line := process.stdout.readline(_LONGEST_LINE):
                    self._hear(line, log)
                status = process.wait()
                with contextlib.suppress(OSError):  # an order that it did not read any more
                    assert process.stdin is not None
                    process.stdin.close()
            log.write(f"(ended with status {status})\n")
            return status

    def _began(self, process: subprocess.Popen[str]) -> None:
        with self._lock:
            self._process, self.pid = process, process.pid
            for order in self._orders:
                _write(process.stdin, order)
        if self._on_start is not None:
            self._on_start(process.pid)

    def _hear(self, line: str, log: IO[str]) -> None:
        event = event_of(line)
        if event is None or event.get("event") != "advance":
            log.write(line)
            log.flush()
        if event is None:
            return
        self.events.put(event)
        if self._after_event is not None:
            extra = self._after_event()
            if extra is not None:
                self.events.put(Extra(extra))


def _log_mode(log: Path) -> str:
    log.parent.mkdir(parents=True, exist_ok=True)
    return "w" if log.exists() and log.stat().st_size > _LARGEST_LOG else "a"


def _write(stream: IO[str] | None, order: str) -> None:
    # A process that has just ended reads nothing any more; the reading thread reports its end.
    with broken_pipes_are_errors(), contextlib.suppress(OSError, ValueError):
        assert stream is not None
        stream.write(order + "\n")
        stream.flush()


def event_of(line: str) -> dict[str, Any] | None:
    """The object of a line, or None for text that is no event."""
    if not line.startswith("{"):
        return None
    try:
        value = parse_json(line.encode("utf-8", "replace"))
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
