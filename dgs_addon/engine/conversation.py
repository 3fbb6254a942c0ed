"""A process of the engine that answers line by line, and the thread that talks to it. Knows no Blender.

Whoever asks does so on a channel of its own and looks later whether there is an answer; on each channel only the
newest question counts. The process ends with this one, however that ends: its standard input closes, and on Linux the
system kills it with the thread that started it.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from typing import IO, Any

from ...core.files import parse_json
from .process import broken_pipes_are_errors, creation_flags, environment

#: Seconds that the process may take to go when it is sent away.
_FAREWELL = 5.0
_LONGEST_LINE = 2**26
#: Characters of its last words that are shown.
_LONGEST_REASON = 300


class Conversation:
    """One process and what was asked of it.

    Args:
        command: starts it; its first line says that it is ready.

    Attributes:
        error: why there are no answers any more, in one line; '' if nothing is wrong.
        ready: whether it has said that it is.
        asked: when it was last asked (of `time.monotonic`).
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.error, self.ready, self.asked = "", False, time.monotonic()
        self._command = list(command)
        self._questions: dict[str, Mapping[str, Any]] = {}
        self._answers: dict[str, dict[str, Any]] = {}
        self._busy: str | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._thread = threading.Thread(target=self._run, name="descatter-answers", daemon=True)
        self._thread.start()

    @property
    def working(self) -> bool:
        """Whether something is not answered yet."""
        return bool(self._questions) or self._busy is not None

    def ask(self, channel: str, question: Mapping[str, Any]) -> None:
        """Asks; returns at once. An older question of the channel that waits is forgotten, and so is its answer."""
        with self._changed:
            self.asked = time.monotonic()
            self._answers.pop(channel, None)
            self._questions[channel] = question
            self._changed.notify_all()

    def take(self, channel: str) -> dict[str, Any] | None:
        """The answer, once; None while there is none. {'event': 'error', 'text': ...} where it went wrong."""
        with self._changed:
            return self._taken(channel)

    def wait(self, channel: str) -> dict[str, Any]:
        """The answer, as soon as it is there."""
        with self._changed:
            while (found := self._taken(channel)) is None:
                self._changed.wait()
            return found

    def close(self) -> None:
        """Ends the process; what was asked is not answered."""
        with self._changed:
            self._closed = True
            self.error = self.error or "The engine was sent away"
            self._changed.notify_all()
            if self._process is not None:
                self._process.kill()
        self._thread.join(_FAREWELL)

    def _taken(self, channel: str) -> dict[str, Any] | None:
        if channel in self._answers:
            return self._answers.pop(channel)
        return {"event": "error", "text": self.error} if self.error else None

    def _run(self) -> None:
        with broken_pipes_are_errors(), tempfile.TemporaryFile() as said:
            try:
                self._talk(said)
            except (OSError, ValueError) as error:
                self._end(str(error) or "The engine ended")
            finally:
                if self._process is not None:
                    self._process.kill()
                    self._process.wait()

    def _talk(self, said: IO[bytes]) -> None:
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            encoding="utf-8",
            errors="replace",
            env=environment(),
            creationflags=creation_flags(),
        )
        with self._changed:
            self._process = process
            if self._closed:
                process.kill()
        assert process.stdin is not None and process.stdout is not None
        line = process.stdout.readline(_LONGEST_LINE)
        self.ready = bool(line)
        while line and (task := self._next()) is not None:
            channel, question = task
            process.stdin.write(json.dumps(question) + "\n")
            process.stdin.flush()
            line = process.stdout.readline(_LONGEST_LINE)
            with self._changed:
                self._busy = None
                if line and channel not in self._questions:
                    self._answers[channel] = _answer(line)
                self._changed.notify_all()
        self._end("" if self._closed else _last_words(process, said))

    def _next(self) -> tuple[str, Mapping[str, Any]] | None:
        with self._changed:
            while not self._questions and not self._closed:
                self._changed.wait()
            if self._closed:
                return None
            self._busy = next(iter(self._questions))
            return self._busy, self._questions.pop(self._busy)

    def _end(self, reason: str) -> None:
        with self._changed:
            self.error, self.ready, self._busy = self.error or reason, False, None
            self._questions.clear()
            self._changed.notify_all()


def _answer(line: str) -> dict[str, Any]:
    with contextlib.suppress(ValueError, RecursionError):
        found = parse_json(line.encode("utf-8", "replace"))
        if isinstance(found, dict):
            return found
    return {"event": "error", "text": "The engine's answer is not understood"}


def _last_words(process: subprocess.Popen[str], said: IO[bytes]) -> str:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_FAREWELL)
    said.seek(0)
    lines = said.read().decode("utf-8", "replace").strip().splitlines()
    return lines[-1][:_LONGEST_REASON] if lines else f"The engine ended with status {process.returncode}"
