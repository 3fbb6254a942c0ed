"""Ctrl-C and SIGTERM: the first asks the work to stop at a safe point, the second stops it at once.

A program that steers the command asks the same, and may let it wait (see `control`).
"""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Self


class Interruption:
    """While entered, signals set a flag that the work reads through `Progress.cancelled`."""

    def __init__(self) -> None:
        self._asked = threading.Event()
        self._free = threading.Event()
        self._free.set()
        self._before: dict[int, object] = {}

    @property
    def asked(self) -> bool:
        """True once the user asked to stop."""
        return self._asked.is_set()

    def ask(self) -> None:
        """Asks the work to stop, as the first Ctrl-C does; work that waits goes on to its stop."""
        self._asked.set()
        self._free.set()

    def pause(self) -> None:
        """Lets the work wait at its next safe point, unless it was asked to stop."""
        if not self.asked:
            self._free.clear()

    def go_on(self) -> None:
        """Ends a pause."""
        self._free.set()

    def wait_while_paused(self) -> None:
        """Returns when the work may go on; at once if nobody paused it."""
        self._free.wait()

    def __enter__(self) -> Self:
        # Only the main thread may set handlers; elsewhere (inside Blender) the caller has its own.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            if handler is not None:  # None: one that was not set from Python (Blender's own)
                signal.signal(number, handler)  # type: ignore[arg-type]
        self._before.clear()

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self._asked.is_set():
            raise KeyboardInterrupt
        self.ask()
        print("Stopping: what is finished will be saved (once more to stop at once).", file=sys.stderr, flush=True)
