"""The picture server's process, and the thread that talks to it. Knows no Blender.

Whoever draws asks on a channel of its own (a viewport, the final picture) and looks later whether the picture is
there; on each channel only the newest question counts. The process is started by the first question. If it dies it is
started again, and gets the twins anew. It ends with this process, however that ends: its standard input closes, and on
Linux the system kills it with the thread that started it.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import DgsError
from ...core.files import parse_json
from ...core.serving.messages import Drawn, SharedTwin, View
from ...core.serving.shared_area import SharedArea
from ..engine.process import RUN, broken_pipes_are_errors, creation_flags, environment

Floats = NDArray[np.float32]

#: A process that has died so often without a picture in between is not started again.
_ATTEMPTS = 3
#: Who asks for the picture that only starts the process.
_NOBODY = Camera("", 16, 16, 16.0, 16.0, 8.0, 8.0, np.eye(3), np.zeros(3))
#: Twins that no question has named for so many questions are dropped, here and there.
_UNUSED_AFTER = 32
#: Seconds that the process may take to go when it is sent away.
_FAREWELL = 5.0
_LONGEST_LINE = 2**20
#: The channel on which splats are weighed.
_WEIGHTS = "weights"
#: Characters of its last words that are shown.
_LONGEST_REASON = 300


@dataclass(frozen=True)
class Picture:
    """What came back.

    Attributes:
        view: what was asked for.
        pixels: [H, W, 4] colours multiplied by alpha, rows upwards; depth: [H, W] or None.
        seconds: from the question's sending to its answer.
    """

    view: View
    pixels: Floats
    depth: Floats | None
    seconds: float


class _Died(Exception):
    """The process has ended."""


class PictureServer:
    """One process that draws, and its twins.

    Args:
        command: starts it.

    Attributes:
        error: why there is no picture, in one line; '' if nothing is wrong.
        pid: of the process; None where there is none.
        starts: how often it was started; drawn: pictures that it has made.
        failed: when it last gave up (of `time.monotonic`).
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.error, self.failed = "", 0.0
        self.starts = self.drawn = 0
        self.pid: int | None = None
        self._command = list(command)
        self._said: IO[bytes] | None = None
        self._twins: dict[str, tuple[SharedTwin, bytes]] = {}
        self._used: dict[str, int] = {}
        self._there: set[str] = set()
        self._asked: dict[str, View] = {}
        self._pictures: dict[str, Picture] = {}
        self._busy: str | None = None
        self._questions = self._failures = 0
        self._closed = False
        self._changed = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._areas: list[SharedArea] = []
        self._thread: threading.Thread | None = None

    def put(self, twin: SharedTwin, content: bytes) -> None:
        """Hands a state of a twin over; nothing happens if it is there already.

        Args:
            content: as `SharedTwin.planes` reads it.
        """
        with self._changed:
            self._used[twin.key] = self._questions
            self._twins.setdefault(twin.key, (twin, content))

    def has(self, key: str) -> bool:
        """Whether a twin was handed over."""
        return key in self._twins

    def retire(self, key: str) -> None:
        """A twin that nobody will ask for again may be dropped before the next picture, but for one that names it."""
        with self._changed:
            self._used[key] = min(self._used.get(key, 0), self._questions - _UNUSED_AFTER)

    def ask(self, channel: str, view: View) -> None:
        """Asks for a picture; returns at once. An older question of the channel that waits is forgotten."""
        with self._changed:
            self._questions += 1
            for twin in view.twins:
                self._used[twin.key] = self._questions
            self._asked.pop(channel, None)
            self._asked[channel] = view
            if self._thread is None:
                # A daemon: Blender must be able to quit while it waits.
                self._thread = threading.Thread(target=self._run, name="descatter-pictures", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def warm_up(self) -> None:
        """Starts the process before anybody waits for a picture; returns at once, and does nothing if there is one."""
        if self._thread is None:
            self.ask("warm", View((), _NOBODY))

    def take(self, channel: str) -> Picture | None:
        """The newest picture of a channel, once."""
        with self._changed:
            return self._pictures.pop(channel, None)

    def waiting(self, channel: str) -> bool:
        """Whether a question of the channel is not answered yet."""
        with self._changed:
            return channel in self._asked or self._busy == channel

    def wait(self, channel: str, seconds: float) -> Picture | None:
        """The channel's picture as soon as it is there; None if it does not come in time, or not at all."""
        end = time.monotonic() + seconds
        with self._changed:
            while channel not in self._pictures and (channel in self._asked or self._busy == channel):
                left = end - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    break
            return self._pictures.pop(channel, None)

    def weights(self, view: View, seconds: float) -> Floats | None:
        """[N] how many px of a view each splat of its twins is, in the order in which they were handed over.

        Waits for it; None if it does not come in time, or not at all.
        """
        self.ask(_WEIGHTS, view)
        answer = self.wait(_WEIGHTS, seconds)
        return None if answer is None else answer.pixels.reshape(-1)

    def close(self) -> None:
        """Ends the process; what was asked is not answered."""
        with self._changed:
            self._closed = True
            self._asked.clear()
            self._changed.notify_all()
            if self._process is not None:
                self._process.kill()
        if self._thread is not None:
            self._thread.join(_FAREWELL)

    def _run(self) -> None:
        with broken_pipes_are_errors():
            self._answer_all()

    def _answer_all(self) -> None:
        while (task := self._next()) is not None:
            channel, view = task
            try:
                picture = self._draw(view, channel == _WEIGHTS)
                with self._changed:
                    self._pictures[channel], self.error, self._failures = picture, "", 0
                    self.drawn += 1
            except _Died as died:
                self._end_process()
                self._failures += 1
                with self._changed:
                    if self._failures < _ATTEMPTS and not self._closed:
                        self._asked.setdefault(channel, view)
                    else:
                        self.error, self.failed, self._failures = str(died), time.monotonic(), 0
            except (OSError, DgsError, ValueError) as error:
                self.error, self.failed = str(error), time.monotonic()
            with self._changed:
                self._busy = None
                self._changed.notify_all()
        self._end_process()

    def _next(self) -> tuple[str, View] | None:
        with self._changed:
            while not self._asked and not self._closed:
                self._changed.wait()
            if self._closed:
                return None
            channel = next(iter(self._asked))
            self._busy = channel
            return channel, self._asked.pop(channel)

    def _draw(self, view: View, weights: bool) -> Picture:
        if self._process is None:
            self._start()
        self._drop_unused()
        for key in {twin.key for twin in view.twins} - self._there:
            self._hand_over(key)
        began = time.perf_counter()
        if weights:
            return Picture(view, self._weigh(view), None, time.perf_counter() - began)
        drawn = Drawn.parse(self._answer({"view": view.message()}, "picture"))
        # A copy: the next picture is drawn while this one is shown.
        pixels, depth = drawn.planes(self._areas[1].view(drawn.bytes))
        copied = pixels.copy(), None if depth is None else depth.copy()
        return Picture(view, *copied, time.perf_counter() - began)

    def _weigh(self, view: View) -> Floats:
        """[N, 1, 1]: no picture, but it takes the same way."""
        count = self._answer({"seen": view.message()}, "seen").get("count")
        held = sum(self._twins[twin.key][0].count for twin in view.twins if twin.key in self._twins)
        if not isinstance(count, int) or not 0 <= count <= held:
            raise ValueError("The engine's answer is not understood")
        return np.frombuffer(self._areas[1].view(4 * count), np.float32, count).copy().reshape(-1, 1, 1)

    def _hand_over(self, key: str) -> None:
        with self._changed:
            held = self._twins.get(key)
        if held is None:
            return
        twin, content = held
        self._areas[0].view(twin.bytes)[:] = content
        self._answer({"twin": {"key": key, "count": twin.count, "harmonics": twin.harmonics}}, "twin")
        self._there.add(key)

    def _drop_unused(self) -> None:
        with self._changed:
            old = [key for key in self._twins if self._questions - self._used.get(key, 0) > _UNUSED_AFTER]
            for key in old:
                del self._twins[key]
                self._used.pop(key, None)
        for key in self._there.intersection(old):
            self._answer({"forget": key}, "forgotten")
            self._there.discard(key)

    def _start(self) -> None:
        self._areas, self._there = [SharedArea.create(), SharedArea.create()], set()
        passed = [area.descriptor for area in self._areas if area.descriptor is not None]
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the process; without a name, so never left)
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            encoding="utf-8",
            errors="replace",
            env=environment(),
            creationflags=creation_flags(),
            pass_fds=passed,
        )
        with self._changed:
            self._process, self.pid, self.starts = process, process.pid, self.starts + 1
            if self._closed:
                process.kill()
        self._answer({"areas": [area.address for area in self._areas]}, "ready")

    def _answer(self, message: dict[str, Any], event: str) -> dict[str, Any]:
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(json.dumps(message) + "\n")
            process.stdin.flush()
            line = process.stdout.readline(_LONGEST_LINE)
        except (OSError, ValueError):  # its end of the pipe is closed
            line = ""
        if not line:
            raise _Died(self._why_it_died(process))
        reply = parse_json(line.encode("utf-8", "replace"))
        if not isinstance(reply, dict) or reply.get("event") != event:
            said = reply.get("text") if isinstance(reply, dict) else None
            raise DgsError(str(said or "The engine's answer is not understood"))
        return reply

    def _why_it_died(self, process: subprocess.Popen[str]) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_FAREWELL)
        words = ""
        if self._said is not None:
            self._said.seek(0)
            lines = self._said.read().decode("utf-8", "replace").strip().splitlines()
            words = f": {lines[-1][:_LONGEST_REASON]}" if lines else ""
        return f"The engine that draws ended with status {process.returncode}{words}"

    def _end_process(self) -> None:
        process, self.pid = self._process, None
        if process is not None:
            process.kill()
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):
                    assert stream is not None
                    stream.close()
            process.wait()
        with self._changed:
            self._process = None
        for area in self._areas:
            area.close()
        self._areas = []
        if self._said is not None:
            self._said.close()


def serve_command(python: Path) -> list[str]:
    """The command that starts the process."""
    return [str(python), str(RUN), "serve"]
