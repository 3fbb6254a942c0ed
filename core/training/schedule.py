"""How far a run is, and when it ends: after so many steps, when its time is up, or when it is good enough.

Everything that changes during a run (grid, density control, step sizes) follows its share of the work in
[0, 1]. Without a time limit that is steps done over steps; with one it is the time, so that the run is
complete when its time is up, however fast the machine turned out to be.
"""

from __future__ import annotations

from typing import Literal

from .settings import TrainingSettings

Ending = Literal["done", "time limit", "quality", "plateau"]

#: No run takes more steps than this, whatever time it is given.
MOST_STEPS = 100_000
#: A plateau: the last share of the work (see below) has brought less than this (dB on held-out photos).
PLATEAU_DB = 0.05
#: Share of the work that a plateau is judged by: the last quarter.
PLATEAU_SHARE = 0.25
#: A run that has reached its plateau lowers its step sizes over this share of the work it has done.
COOLING = 0.15


class Schedule:
    """The share of a run and its end.

    Args:
        settings: `steps` are the whole run's, expected ones where there is a time limit; `until` and `min_steps`.
        limit: seconds that this run may take, None for no limit.
        step: steps done before (a resumed run).
    """

    def __init__(self, settings: TrainingSettings, limit: float | None, step: int = 0) -> None:
        self._settings, self._limit, self._before = settings, limit, step
        self._start = 0.0 if limit is None else min(step / settings.steps, 0.9)
        self._cooling: tuple[float, float] | None = None
        self._met = False
        self._known: list[tuple[float, float]] = []

    def _work(self, step: int, spent: float) -> float:
        """Share of the planned run."""
        if self._limit is None:
            return step / self._settings.steps
        done = step - self._before
        # Steps that are asked for take the time they take.
        needed = spent * (self._settings.min_steps - self._before) / done if done else 0.0
        return self._start + (1 - self._start) * spent / max(self._limit, needed, 1e-6)

    def share(self, step: int, spent: float) -> float:
        """In [0, 1]: what the optimization follows. `spent`: seconds of this run."""
        work = self._work(step, spent)
        if self._cooling is None:
            return min(work, 1.0)
        began, length = self._cooling
        return min(1.0, began + (1.0 - began) * (work - began) / length)

    def look(self, step: int, spent: float, psnr: float | None) -> None:
        """Takes in the accuracy on held-out photos (dB)."""
        until = self._settings.until
        if until is None or psnr is None:
            return
        if until != "plateau":
            self._met |= psnr >= float(until)
            return
        work = self._work(step, spent)
        self._known.append((work, psnr))
        before = [known for at, known in self._known if at <= work * (1 - PLATEAU_SHARE)]
        # The first phases have rests of their own, before the full grid and the photos themselves take over.
        first = max(self._settings.coarse_share, self._settings.start_share)
        ripe = work * (1 - PLATEAU_SHARE) >= first and step >= self._settings.min_steps
        if self._cooling is None and ripe and before and psnr - before[-1] < PLATEAU_DB:
            self._cooling = work, COOLING * work

    def ended(self, step: int, spent: float) -> Ending | None:
        """Why the run is over; None while it is not."""
        s = self._settings
        if step < s.min_steps and step < MOST_STEPS and (self._limit is not None or s.until is not None):
            return None
        if self._met:
            return "quality"
        if self._cooling is not None and self.share(step, spent) >= 1.0:
            return "plateau"
        if self._limit is not None:
            return "time limit" if spent >= self._limit else "done" if step >= MOST_STEPS else None
        return "done" if step >= s.steps else None
