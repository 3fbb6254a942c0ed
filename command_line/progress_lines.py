"""Progress for logs: a line when a stage begins and every so often while it runs; or nothing."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self, TextIO

from .interruption import Interruption
from .time_left import TimeLeft

#: A stage that takes longer says so this often (s).
INTERVAL = 10.0


class Lines:
    """Plain lines for a log file.

    Args:
        stream: where stages and notes go; None for silence.
        results: where the results go.
    """

    def __init__(self, stream: TextIO | None, results: TextIO, interruption: Interruption) -> None:
        self._stream = stream
        self._results = results
        self._interruption = interruption
        self._name = ""
        self._total: int | None = None
        self._written = 0.0
        self._left = TimeLeft()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; `total` steps if they can be counted."""
        self._name, self._total = name, total
        self._written = time.monotonic()
        self._left.begin(total)
        self._say(f"{name} ({total})" if total else name)

    def advance(self, done: int, **figures: float) -> None:
        """So many steps of the stage are done; figures worth showing."""
        now, left = time.monotonic(), self._left.after(done)
        if now - self._written < INTERVAL:
            return
        self._written = now
        values = "".join(f", {key} {value:.4g}" for key, value in figures.items())
        words = "" if left is None else f", {left:.0f} s left"
        self._say(f"  {self._name} {done}{f' of {self._total}' if self._total else ''}{values}{words}")

    def note(self, text: str) -> None:
        """Something the user should read, in one line."""
        self._say(f"  note: {text}")

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        return self._interruption.asked

    def finished(self, result: dict[str, object]) -> None:
        """The work is done: the last words."""
        if self._stream is None:
            return
        for key, value in result.items():
            if value is not None:
                print(f"{key:>12}  {value}", file=self._results, flush=True)

    def failed(self, line: str, status: int) -> None:
        """The work ended with an error: what and the way out (the error itself is printed elsewhere)."""

    def _say(self, text: str) -> None:
        if self._stream is not None:
            print(text, file=self._stream, flush=True)
