"""A few commands one after the other beside Blender, whose output is read. Knows no Blender."""

from __future__ import annotations

import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .process import creation_flags, environment, give_way

#: Lines that are kept for reading: enough for a long traceback of pip, and for an answer that names a hundred views.
_KEPT = 8000


@dataclass(frozen=True)
class ErrandStep:
    """A command with what it is called, or something to do once those before it went well."""

    title: str
    action: Sequence[str] | Callable[[], None]

    @property
    def steered(self) -> bool:
        """Whether the command obeys its standard input and ends with this process (`command_line.control`)."""
        return not callable(self.action) and "--control" in self.action


class Errand:
    """Runs steps in a thread until one fails or the user cancels.

    Attributes:
        title: what happens now.
        done, total: steps finished, and all.
        lines: the last lines of the commands' output.
        status: None while it runs; 0 if all went well; else the failed command's, or -1 if cancelled.
    """

    def __init__(self, steps: Sequence[ErrandStep], log: Path | None = None) -> None:
        self.title, self.done, self.total = "", 0, len(steps)
        self.lines: deque[str] = deque(maxlen=_KEPT)
        self.status: int | None = None
        self.cancelled = False
        self._steps, self._log = list(steps), log
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="descatter-errand", daemon=True)

    @property
    def running(self) -> bool:
        """Whether it works now."""
        return self.status is None

    def start(self) -> None:
        """Returns at once."""
        self._thread.start()

    def cancel(self) -> None:
        """Ends the command that runs, and with it the errand."""
        with self._lock:
            self.cancelled = True
            if self._process is not None:
                self._process.kill()

    def join(self, seconds: float) -> bool:
        """Waits for the end; False if it did not come in time."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        status = 0
        for step in self._steps:
            self.title = step.title
            try:
                status = self._do(step)
            except OSError as error:
                self.lines.append(f"{step.title}: {error}")
                status = 1
            if status or self.cancelled:
                break
            self.done += 1
        self._keep()
        self.status = -1 if self.cancelled else status

    def _do(self, step: ErrandStep) -> int:
        if callable(step.action):
            step.action()
            return 0
        self.lines.append("$ " + " ".join(step.action))
        with subprocess.Popen(
            list(step.action),
            stdin=subprocess.PIPE if step.steered else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            env=environment(),
            creationflags=creation_flags(),
        ) as process:
            if not step.steered:  # (it steps back by itself)
                give_way(process.pid)
            with self._lock:
                self._process = process
                if self.cancelled:
                    process.kill()
            assert process.stdout is not None
            for line in process.stdout:
                if line.strip():
                    self.lines.append(line.rstrip())
            return process.wait()

    def _keep(self) -> None:
        if self._log is not None:
            try:
                self._log.write_text("\n".join(self.lines) + "\n", encoding="utf-8")
            except OSError as error:
                self.lines.append(f"No log: {error}")
