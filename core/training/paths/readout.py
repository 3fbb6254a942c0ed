"""How long a rolling shutter takes from a photo's first row to its last one, found of all photos together.

Where the rows are exposed one after the other, the row at the share v of the height sees an exposure of the path around
the time (v - 1/2) R, R the readout in exposures. So the photo y changes with R by

    dy / dR = (v - 1/2) (what the row saw last - what it saw first),

and every visit of a photo gives a Gauss-Newton step of R, its path free to follow. As long as R is 0 a path may be run
in either direction, so that the sign of a photo's step says nothing. Its square does: it is far beyond its variance in
all photos, and far more so than for columns in the place of rows, which no shutter of an upright photo follows. Then
the paths are turned so that all steps have one sign, and R moves on by the photos' mean step after each round of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...imaging.formation.row_windows import over_photo, row_ends, was_turned
from ...numbers import number
from .along import changed_by
from .equations import PathEquations
from .slopes import Looked

Array = NDArray[np.float64]

#: What the numbers below were chosen on.
_ROLLING = "shelf, 16 photos rendered by Cycles with readouts of 0, 0.5 and 1: mean squares of 0.3, 30 and 40"

#: What they were checked on.
_CHECKED = "shelf with 0.25 and 2, turned upright with 0.5: found; a shaken village and tea (real): none, 0.2 to 0.6"


@dataclass(frozen=True)
class ReadoutSettings:
    """When a shutter rolls, and how its readout moves."""

    visits: int = number(
        3, "visits", "of every photo, before it is asked for: paths have to be found first", _ROLLING, _CHECKED
    )
    fewest: int = number(5, "photos", "whose path says something of it, or there is none", "a first choice")
    seen: float = number(
        1.5,
        "variances",
        "that the photos' squared steps have in the mean where the shutter rolls",
        f"{_ROLLING}; an orrery of as many, readouts of 0 and 0.5: 0.2 and 1.3, rising to 4; with 4 it was found late",
        _CHECKED,
    )
    beyond_columns: float = number(
        2.0, "times", "as much as with columns in the place of rows", f"{_ROLLING}; with columns 0.5, 6 and 9", _CHECKED
    )
    faster: float = number(
        1.5, "factor", "on each further step of the same sign: the twin hides a part of what is left", "a first choice"
    )
    fastest: float = number(4.0, "factor", "on a step at most", "a first choice")
    longest_step: float = number(0.5, "exposures", "that it changes by at a time", "a first choice")
    longest: float = number(4.0, "exposures", "that are found: the path's frames grow with it", "a first choice")
    least: float = number(0.02, "exposures", "below which all rows are exposed at once", "a first choice")


SETTINGS = ReadoutSettings()


def slopes_in_readout(looked: Looked, readout: float) -> Tensor:
    """[2, 3, h, w] of the photo (sRGB) by the readout, in exposures; the second with columns in the place of rows.

    Rows are the sensor's: columns of a photo that was turned upright.
    """
    exposed, at = looked.exposed, looked.at
    height, width = exposed.shot.height, exposed.shot.width
    turned = was_turned(height, width)
    ends = row_ends(len(exposed.frames), min(height, width), torch.tensor(readout), exposed.shot.margin)
    change = changed_by(looked, over_photo(ends, turned))
    down, across = ((torch.arange(side) + 0.5) / side - 0.5 for side in (height, width))
    both = change * down[at.rows][:, None], change * across[at.columns]
    return torch.stack(both[::-1] if turned else both)


def step_and_variance(path: PathEquations, which: slice) -> tuple[float, float]:
    """A photo's own step of the readout, its path following, and the variance of that; endless where it says nothing.

    Args:
        which: of what was asked beside the path is the readout.
    """
    precision, wanted = (float(found.item()) for found in path.step_of(which))
    if not precision > 1e-6:
        return 0.0, np.inf
    return wanted / precision, 1.0 / precision


class LearnedReadout:
    """What the visits of the fitted photos say of the readout.

    Args:
        photos: how many are fitted.

    Attributes:
        error: standard error of the readout; None as long as none was found.
    """

    def __init__(self, photos: int, settings: ReadoutSettings = SETTINGS) -> None:
        self.settings = settings
        self.error: float | None = None
        self._latest = np.full((photos, 4), np.nan)  # steps and variances, with rows and with columns
        self._visits = np.zeros(photos, np.int64)
        self._pace = 0.0  # of the last step: factor on it, with its sign

    def see(self, photo: int, found: tuple[float, float, float, float]) -> None:
        """Keeps a photo's own step and its variance, with rows and with columns, in the place of its last one."""
        self._visits[photo] += 1
        self._latest[photo] = found

    def see_nothing(self, photo: int) -> None:
        """The same of a photo that stood still."""
        self.see(photo, (0.0, np.inf, 0.0, np.inf))

    @property
    def due(self) -> bool:
        """Whether all photos have said something since the readout moved last."""
        seen = bool(np.isfinite(self._latest[:, 0]).all()) and len(self._latest) > 0
        return seen and int(self._visits.min()) >= self.settings.visits

    def moved(self, readout: float) -> tuple[float, NDArray[np.bool_]]:
        """The readout after a round of the photos, and [F] of which photos the path has to be run the other way.

        Args:
            readout: as it was in this round.
        """
        s = self.settings
        steps, precisions = self._latest[:, 0], 1.0 / self._latest[:, 1]
        if readout == 0.0:
            if not self._rolls():
                return self._next(0.0), np.zeros(len(steps), np.bool_)
            turned = steps < 0.0
            steps = np.abs(steps)
        else:
            turned = np.zeros(len(steps), np.bool_)
        whole = float(precisions.sum())
        if not whole > 0.0:
            return self._next(readout), turned
        step = float(steps @ precisions) / whole
        same = step * self._pace > 0.0
        pace = min(abs(self._pace) * s.faster, s.fastest) if same else 1.0
        self._pace = float(np.copysign(pace, step))
        found = min(readout + float(np.clip(pace * step, -s.longest_step, s.longest_step)), s.longest)
        self.error = None if found < s.least else float(1.0 / np.sqrt(whole))
        return self._next(0.0 if found < s.least else found), turned

    def _next(self, readout: float) -> float:
        """Begins a new round of the photos."""
        self._latest[:] = np.nan
        return readout

    def _rolls(self) -> bool:
        """Whether squared steps are more than chance, and more than columns in the place of rows have."""
        s, informed = self.settings, np.isfinite(self._latest[:, 1])
        if int(informed.sum()) < s.fewest:
            return False
        rows, columns = (np.square(self._latest[informed, k]) / self._latest[informed, k + 1] for k in (0, 2))
        return bool(rows.mean() > max(s.seen, s.beyond_columns * float(columns.mean())))

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        pace = np.array([self._pace, np.nan if self.error is None else self.error])
        return {"readout.latest": self._latest.copy(), "readout.visits": self._visits.copy(), "readout.pace": pace}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        latest, visits, pace = (arrays.get(f"readout.{name}") for name in ("latest", "visits", "pace"))
        if latest is None or visits is None or pace is None or latest.shape != self._latest.shape:
            return False
        if visits.shape != self._visits.shape or pace.shape != (2,):
            return False
        self._latest, self._visits = np.array(latest, np.float64), np.array(visits, np.int64)
        self._pace, self.error = float(pace[0]), float(pace[1]) if np.isfinite(pace[1]) else None
        return True
