"""Ctrl-C and SIGTERM: the first asks the work to stop at a safe point, the second stops it at once.

Work that saves nothing is stopped by the first, soon: native code, such as the compiler of the kernels, does not let
Python hear of a signal before it is done. A program that steers the command asks the same, and may let it wait (see
`control`).
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from types import FrameType, TracebackType
from typing import Self

from ..core.errors import Cancelled

#: Seconds that work which saves nothing has to end by itself when it was asked to stop.
GRACE = 0.5


class Interruption:
    """While entered, signals set a flag that the work reads through `Progress.cancelled`.

    Args:
        saves: whether the work has anything to save when it is asked to stop; if not, it is stopped at once.
    """

    def __init__(self, saves: bool = True) -> None:
        self._saves, self._said = saves, threading.Event()
        self._asked = threading.Event()
        self._free = threading.Event()
        self._free.set()
        self._before: dict[int, object] = {}
        self._woken: tuple[int, int] | None = None  # whom signals woke before, and the pipe that they write to now

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
            if not self._saves:
                self._watch()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            if handler is not None:  # None: one that was not set from Python (Blender's own)
                signal.signal(number, handler)  # type: ignore[arg-type]
        self._before.clear()
        if self._woken is not None:
            signal.set_wakeup_fd(self._woken[0])
            os.close(self._woken[1])  # nobody watches work that has ended
            self._woken = None

    def said(self) -> None:
        """The user has read that the work has stopped."""
        self._said.set()

    def _watch(self) -> None:
        """Ends this process soon after the first signal, whatever its other threads do."""
        heard, written = os.pipe()
        os.set_blocking(written, False)
        self._woken = signal.set_wakeup_fd(written, warn_on_full_buffer=False), written

        def end() -> None:
            while (received := os.read(heard, 1)) and received[0] not in (signal.SIGINT, signal.SIGTERM):
                pass
            if not received:
                os.close(heard)
                return
            time.sleep(GRACE)
            if not self._said.is_set():
                os.write(2, b"Stopped.\n")
            os._exit(Cancelled.exit_code)

        threading.Thread(target=end, daemon=True).start()

    def _receive(self, number: int, frame: FrameType | None) -> None:
        stopped = self._asked.is_set() or not self._saves
        self.ask()
        if stopped:
            sys.unraisablehook = lambda _: None  # what is interrupted while it is taken down has nothing to say
            raise KeyboardInterrupt
        print("Stopping: what is finished will be saved (once more to stop at once).", file=sys.stderr, flush=True)
