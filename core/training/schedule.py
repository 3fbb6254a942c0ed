"""How far a run is, and when it ends: after so many steps, when its time is up, or when it is good enough.

Everything that changes during a run (grid, density control, step sizes) follows its share of the work in
[0, 1]. Without a time limit that is steps done over steps; with one it is the time, so that the run is
complete when its time is up, however fast the machine turned out to be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ..numbers import number
from .settings import TrainingSettings

Ending = Literal["done", "time limit", "quality", "plateau"]


@dataclass(frozen=True)
class ScheduleSettings:
    """Numbers of a run's end."""

    maximum_steps: int = number(100_000, "steps", "that no run exceeds, whatever time it is given")
    latest_resumption: float = number(
        0.9, "share of the run", "a resumed run with a time limit begins no later, so that its last phases are not lost"
    )
    plateau_gain: float = number(
        0.05, "dB on held-out photos", "a plateau: the best score of the last share of the work gains less than this"
    )
    plateau_share: float = number(0.25, "share of the work", "that a plateau is judged by: the last quarter")
    cooling: float = number(
        0.15, "share of the work done", "over which a run that has reached its plateau lowers its step sizes"
    )
    harmonics_until: float = number(
        0.3,
        "share of the run",
        "over which colours learn to change with the direction, degree by degree from 1 to the highest: shapes come"
        " first, and steps are quicker",
        "the order is that of 3D Gaussian splatting (Kerbl et al. 2023); the share is a first choice",
    )


SCHEDULE = ScheduleSettings()


def harmonics_degree(share: float, highest: int) -> int:
    """Degree of the harmonics at a share in [0, 1] of the run."""
    if highest <= 1 or share >= SCHEDULE.harmonics_until:
        return highest
    return 1 + int(share / SCHEDULE.harmonics_until * (highest - 1))


class Schedule:
    """The share of a run and its end.

    Args:
        settings: `steps` are the whole run's, expected ones where there is a time limit; `until` and `min_steps`.
        limit: seconds that this run may take, None for no limit.
        step: steps done before (a resumed run).
    """

    def __init__(self, settings: TrainingSettings, limit: float | None, step: int = 0) -> None:
        self._settings, self._limit, self._before = settings, limit, step
        self._start = 0.0 if limit is None else min(step / settings.steps, SCHEDULE.latest_resumption)
        self._cooling: tuple[float, float] | None = None
        self._met = False
        self._evaluations: list[tuple[float, float]] = []

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

    def evaluated(self, step: int, spent: float, psnr: float | None) -> None:
        """Takes in the accuracy on held-out photos (dB)."""
        until = self._settings.until
        if until is None or psnr is None:
            return
        if until != "plateau":
            self._met |= psnr >= float(until)
            return
        work = self._work(step, spent)
        self._evaluations.append((work, psnr))
        # The best of each part: single scores swing by a dB and more, as Gaussians come and go.
        quarter = work * (1 - SCHEDULE.plateau_share)
        before = [earlier for at, earlier in self._evaluations if at <= quarter]
        later = [latest for at, latest in self._evaluations if at > quarter]
        gained = max(later, default=psnr) - max(before, default=-math.inf)
        # The first phases have rests of their own, before the full grid and the photos themselves take over.
        first = max(self._settings.coarse_share, self._settings.start_share)
        ripe = quarter >= first and step >= self._settings.min_steps
        if self._cooling is None and ripe and gained < SCHEDULE.plateau_gain:
            self._cooling = work, SCHEDULE.cooling * work

    def ended(self, step: int, spent: float) -> Ending | None:
        """Why the run is over; None while it is not."""
        s = self._settings
        if step < s.min_steps and step < SCHEDULE.maximum_steps and (self._limit is not None or s.until is not None):
            return None
        if self._met:
            return "quality"
        if self._cooling is not None and self.share(step, spent) >= 1.0:
            return "plateau"
        if self._limit is not None:
            return "time limit" if spent >= self._limit else "done" if step >= SCHEDULE.maximum_steps else None
        return "done" if step >= s.steps else None
