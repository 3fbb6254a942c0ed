"""Progress as one JSON object a line, for programs that run the command (the panel does).

{"event": "stage", "name": "train", "total": 1000}
{"event": "advance", "stage": "train", "done": 40, "total": 1000, "seconds_left": 21.3, "loss": 0.04}
{"event": "note", "text": "..."}
{"event": "done", "result": {...}}      or      {"event": "error", "text": "...", "status": 2}
"""

from __future__ import annotations

import json
import math
import threading
import time
from types import TracebackType
from typing import Self, TextIO

from .interruption import Interruption
from .time_left import TimeLeft

#: At most this often an `advance` is written (s); the last one of a stage always is.
INTERVAL = 0.1


class JsonLines:
    """Writes events to `stream`; safe to call from several threads."""

    def __init__(self, stream: TextIO, interruption: Interruption, interval: float = INTERVAL) -> None:
        self._stream = stream
        self._interruption = interruption
        self._interval = interval
        self._lock = threading.Lock()
        self._name, self._written = "", -math.inf
        self._total: int | None = None
        self._left = TimeLeft()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; `total` steps if they can be counted."""
        self._name, self._total, self._written = name, total, -math.inf
        self._left.begin(total)
        self._write({"event": "stage", "name": name, "total": total})

    def advance(self, done: int, **figures: float) -> None:
        """So many steps of the stage are done; figures worth showing."""
        now, left = time.monotonic(), self._left.after(done)
        if now - self._written < self._interval and done != self._total:
            return
        self._written = now
        event = {"event": "advance", "stage": self._name, "done": done, "total": self._total}
        event["seconds_left"] = None if left is None else round(left, 1)
        # Figures come second so that none can overwrite the fields that readers rely on.
        self._write({**{key: _finite(value) for key, value in figures.items()}, **event})

    def note(self, text: str) -> None:
        """Something the user should read, in one line."""
        self._write({"event": "note", "text": text})

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        paused = time.monotonic()
        self._interruption.wait_while_paused()
        self._left.wait(time.monotonic() - paused)
        return self._interruption.asked

    def finished(self, result: dict[str, object]) -> None:
        """The work is done: the last words."""
        self._write({"event": "done", "result": result})

    def failed(self, line: str, status: int) -> None:
        """The work ended with an error: what and the way out."""
        self._write({"event": "error", "text": line, "status": status})

    def _write(self, event: dict[str, object]) -> None:
        with self._lock:
            self._stream.write(json.dumps(event, ensure_ascii=True, allow_nan=False) + "\n")
            self._stream.flush()


def _finite(value: float) -> float | None:
    """JSON has no NaN and no infinity."""
    value = float(value)
    return value if math.isfinite(value) else None
