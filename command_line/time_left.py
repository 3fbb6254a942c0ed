"""How long a stage will still take; nothing as long as that would be a guess."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

from ..core.numbers import number


@dataclass(frozen=True)
class TimeLeftSettings:
    """When a rate is believed."""

    advances: int = number(
        4,
        "count",
        "reports after the first before a rate is believed: fewer can be the library's start or one slow step",
        chosen_on="the stages in tests/command_line/test_time_left.py",
    )
    seconds: float = number(
        2.0,
        "s",
        "time after the first report before a rate is believed; stages that end sooner need no estimate",
        chosen_on="the stages in tests/command_line/test_time_left.py",
    )
    largest_ratio: float = number(
        2.0,
        "ratio",
        "of the rates of all and of the latter half of the time: a stage whose rate changes by more is not predicted",
        chosen_on="the stages in tests/command_line/test_time_left.py",
    )


class TimeLeft:
    """Watches one stage after the other.

    What happens before the first report of a stage (a library starts, kernels are compiled, features are found) says
    nothing about its steps, and is left out.

    Args:
        clock: gives seconds; for tests.
    """

    def __init__(
        self, settings: TimeLeftSettings = TimeLeftSettings(), clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._settings, self._clock = settings, clock
        self._waited = 0.0
        self.begin(None)

    def begin(self, total: int | None) -> None:
        """A new stage; `total` steps if they can be counted."""
        self._total = total
        self._times: list[float] = []
        self._counts: list[int] = []

    def wait(self, seconds: float) -> None:
        """The user let the work wait for so long: that is no work."""
        self._waited += seconds

    def after(self, done: int) -> float | None:
        """Seconds until the stage ends, now that `done` steps are done; None where nobody can say."""
        if not self._total:
            return None
        if done >= self._total:
            return 0.0
        if self._counts and done < self._counts[-1]:  # another attempt began from the start
            self.begin(self._total)
        if not self._counts or done > self._counts[-1]:
            self._times.append(self._clock() - self._waited)
            self._counts.append(done)
        rate = self._rate()
        return None if rate is None else (self._total - done) / rate

    def _rate(self) -> float | None:
        """Steps a second over the latter half of the time, if that is about as fast as the whole."""
        spent = self._times[-1] - self._times[0]
        if len(self._counts) <= self._settings.advances or spent < self._settings.seconds:
            return None
        middle = min(bisect_left(self._times, self._times[-1] - spent / 2), len(self._times) - 2)
        whole = (self._counts[-1] - self._counts[0]) / spent
        latter = (self._counts[-1] - self._counts[middle]) / (self._times[-1] - self._times[middle])
        ratio = max(whole, latter) / min(whole, latter)
        return latter if ratio <= self._settings.largest_ratio else None
