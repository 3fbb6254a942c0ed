"""What a run asks about its time, and what it leaves for the next one's; `core.effort.timing` answers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from ..machine import Machine
from ..photos.load import Photo
from ..progress import Progress
from ..training.job import PlannedTraining, TrainingJob


class Timing(Protocol):
    """The time of one run."""

    @property
    def limited(self) -> bool:
        """Whether there is a time limit."""

    def hurry(self, photos: Sequence[Photo]) -> bool:
        """Whether the cameras must be found in a hurry."""

    def plan(
        self, job: TrainingJob, photos: Sequence[Photo], fixed: int | None, earlier: Mapping[str, Any] | None
    ) -> PlannedTraining:
        """The training that fits into what is left.

        Args:
            photos: those with a camera; fixed: Gaussians, where the user wants so many.
            earlier: the plan of the run that is resumed, empty where it is gone; None for a new run.
        """

    def for_trials(self) -> Callable[[], float]:
        """Seconds that are left to trials of effects, from now on asked each time; infinite without a limit."""

    def another(self) -> bool:
        """Whether there is time to score one more view; asked by several threads, each time before one."""

    def overrun(self) -> float:
        """Seconds by which the time limit was passed; 0 where it was kept as well as is promised."""

    def predicted(self, photos: Sequence[Photo]) -> dict[str, Any] | None:
        """What was said before the run about its time; None if nothing was."""

    def keep(self, report: Mapping[str, Any], photos: Sequence[Photo], fitted: int, page: float) -> None:
        """Remembers a finished run.

        Args:
            report: content of report.json; fitted: photos that were trained on.
            page: seconds that writing the report itself took.
        """


#: Makes the `Timing` of a run on a machine; the callable says how many seconds it has worked so far.
MakeTiming = Callable[[Machine, Callable[[], float]], Timing]


class Untimed:
    """As much time as it takes, and nothing remembered."""

    limited = False

    def __init__(self, machine: Machine, spent: Callable[[], float]) -> None:
        """As `MakeTiming`; neither matters."""

    def hurry(self, photos: Sequence[Photo]) -> bool:
        """No."""
        return False

    def plan(
        self, job: TrainingJob, photos: Sequence[Photo], fixed: int | None, earlier: Mapping[str, Any] | None
    ) -> PlannedTraining:
        """The training as it was asked for."""
        return PlannedTraining(job.settings)

    def for_trials(self) -> Callable[[], float]:
        """As many as they take."""
        return lambda: math.inf

    def another(self) -> bool:
        """Yes."""
        return True

    def overrun(self) -> float:
        """There is no limit to pass."""
        return 0.0

    def predicted(self, photos: Sequence[Photo]) -> dict[str, Any] | None:
        """Nothing was."""
        return None

    def keep(self, report: Mapping[str, Any], photos: Sequence[Photo], fitted: int, page: float) -> None:
        """Nothing is."""


class NoteKeeper:
    """Passes progress on and keeps the notes for the report."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.notes: list[str] = []
        #: Seconds that the user let the work wait.
        self.waited = 0.0

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; `total` steps if they can be counted."""
        self._progress.stage(name, total)

    def advance(self, done: int, **figures: float) -> None:
        """So many steps of the stage are done; figures worth showing."""
        self._progress.advance(done, **figures)

    def note(self, text: str) -> None:
        """Something the user should read, in one line."""
        self.notes.append(text)
        self._progress.note(text)

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        asked = time.perf_counter()
        answer = self._progress.cancelled()
        self.waited += time.perf_counter() - asked
        return answer


class Stopwatch:
    """Seconds of each named stage and in all, since `began` on the clock of `time.perf_counter`."""

    def __init__(self, began: float | None = None) -> None:
        self.began = self._lap = time.perf_counter() if began is None else began
        self.seconds: dict[str, float] = {}
        if began is not None:
            self.lap("start")

    def lap(self, name: str) -> None:
        """The time since the last lap belongs to `name`."""
        now = time.perf_counter()
        self.seconds[name] = round(now - self._lap, 3)
        self._lap = now

    def part(self, name: str, parts: Mapping[str, float]) -> None:
        """Of the seconds of a lap, these belong to parts of their own."""
        self.seconds[name] = round(max(0.0, self.seconds[name] - sum(parts.values())), 3)
        self.seconds.update(parts)

    def total(self) -> float:
        """Seconds since the start."""
        return round(time.perf_counter() - self.began, 3)
