"""Where a job stands, event by event, and what its end means. Knows no Blender."""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass, field
from typing import Any, Literal

from ...core.json_shape import anything, check_shape, count, number, sentence, text

Phase = Literal["running", "paused", "cancelling", "done", "cancelled", "failed"]

#: Phases of a job that still works.
ALIVE = ("running", "paused", "cancelling")
#: What the engine's stages are called in the panel.
STAGES = {
    "movie": "Choosing frames",
    "photos": "Reading photos",
    "cameras": "Finding cameras",
    "surface": "Finding surfaces",
    "geometry": "Preparing surfaces",
    "compile": "Compiling",
    "train": "Optimizing",
    "changes": "Looking for changes",
    "depth": "Looking at surfaces",
    "match": "Comparing surfaces",
    "fuse": "Joining surfaces",
    "mesh": "Making the mesh",
    "colour": "Colouring the mesh",
    "unwrap": "Unwrapping the mesh",
    "texture": "Painting the texture",
    "look": "Measuring",
    "features": "Matching photos",
    "compare": "Comparing",
    "update": "Updating",
    "save": "Scoring and saving",
    "render": "Rendering",
}

#: Windows' name for ended by the system or crashed, as an unsigned status.
_WINDOWS = {0xC0000005: "memory access violation", 0xC00000FD: "stack overflow", 0xC000013A: "Ctrl-C"}
#: What usually lies behind a signal.
_CAUSES = {
    "SIGKILL": "the system ran out of memory, or someone ended it",
    "SIGSEGV": "a crash in native code",
    "SIGABRT": "native code gave up",
    "SIGILL": "this processor lacks an instruction that the libraries need",
    "SIGBUS": "a disk that is full or gone, or a damaged file",
    "SIGTERM": "someone ended it",
}
#: What a job that ended by force leaves.
_KEPT = "What was saved up to 30 s before is kept: press Resume to go on from there."
#: What is read of each of the engine's events; figures that were not measured are null.
_EVENTS = {
    "stage": {"name": text, "total?": (count,)},
    "advance": {
        "stage": text,
        "done": count,
        "total?": (count,),
        "seconds_left?": (number,),
        "loss?": (number,),
        "heldout_psnr?": (number,),
    },
    "note": {"text": sentence},
    "done": {"result?": ({"registered?": sentence, "*": anything},)},
    "error": {"text": sentence},
}
#: Exit status of a run that stopped because it was asked to, as of a shell's Ctrl-C.
_CANCELLED = 130


@dataclass(frozen=True)
class Mark:
    """One point of the run's curves: iteration, loss, and PSNR in dB of held-out photos where there are any."""

    step: int
    loss: float
    psnr: float | None


@dataclass
class JobState:
    """Where a job stands.

    Attributes:
        stage: the engine's name of what it does now; '' before its first event.
        done, total: steps of that stage; total None where nobody can say.
        seconds_left: of that stage, or None.
        marks: points of the curves, in order.
        notes: of the engine, for the user.
        error: what went wrong, with the way out; '' as long as nothing did.
        result: what was written, and key figures.
        began, ended: seconds of the monotonic clock.
    """

    phase: Phase = "running"
    stage: str = ""
    done: int = 0
    total: int | None = None
    seconds_left: float | None = None
    marks: list[Mark] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None

    @property
    def alive(self) -> bool:
        """Whether the engine still works on it."""
        return self.phase in ALIVE

    @property
    def factor(self) -> float:
        """Share of the stage that is done, 0 to 1."""
        return min(1.0, self.done / self.total) if self.total else 0.0

    @property
    def title(self) -> str:
        """What happens now, for people."""
        return STAGES.get(self.stage, self.stage.capitalize()) if self.stage else "Starting the engine"

    def seconds(self) -> float:
        """How long it has been going, or went."""
        return (self.ended if self.ended is not None else time.monotonic()) - self.began

    def apply(self, event: dict[str, Any]) -> None:
        """Takes in one event of the engine (see docs/report.md); unknown and damaged ones are of no concern."""
        kind = event.get("event")
        if not isinstance(kind, str) or kind not in _EVENTS:
            return
        try:
            check_shape(event, _EVENTS[kind])
        except ValueError:
            return
        if kind == "stage":
            self.stage, self.total = event["name"], event.get("total")
            self.done, self.seconds_left = 0, None
        elif kind == "advance":
            self.done, self.total = event["done"], event.get("total")
            self.seconds_left = event.get("seconds_left")
            if event["stage"] == "train" and event.get("loss") is not None:
                self.marks.append(Mark(self.done, float(event["loss"]), event.get("heldout_psnr")))
        elif kind == "note":
            self.notes.append(event["text"])
        elif kind == "done":
            self.result = dict(event.get("result") or {})
        else:
            self.error = event["text"]

    def end(self, phase: Phase, error: str = "") -> None:
        """The process has ended."""
        self.phase, self.ended = phase, time.monotonic()
        self.error = error


def duration_text(seconds: float) -> str:
    """'8 s', '2 min 05 s' or '1 h 10 min'."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


def ending(status: int, said: str, cancelled: bool) -> tuple[Phase, str]:
    """How a job ended.

    Args:
        status: exit status; negative is the signal that ended the process.
        said: the engine's own error, or ''.
        cancelled: whether the user had asked to stop.

    Returns:
        The phase, and what went wrong ('' if nothing did).
    """
    if status == 0:
        return "done", ""
    if status == _CANCELLED or (cancelled and status < 0):
        return "cancelled", ""
    if said:
        return "failed", said
    return "failed", _unsaid(status)


def _unsaid(status: int) -> str:
    if status < 0:
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = f"signal {-status}"
        return f"The engine was ended by {name} ({_CAUSES.get(name, 'outside our control')}). {_KEPT}"
    crash = _WINDOWS.get(status & 0xFFFFFFFF)
    if crash is not None:
        return f"The engine crashed ({crash}). {_KEPT}"
    return f"The engine ended with status {status} and no message; press Show Log to see its last lines."
