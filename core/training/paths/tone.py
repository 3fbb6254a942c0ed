"""A camera's own contrast, found of all photos of a moving camera together.

What a px shows of a moving camera is a mean of light, and a camera files light by a curve of its own
(`core.tone_curve.ToneCurve`): so edges along a path say what the curve is. With the frames' values v_k and shares w_k,
u = u(v) and D(u) linear light, the photo is the v of D(u(v)) = sum of w_k D(u(v_k)), and changes with a parameter p of
the curve by

    dv / dp = (sum of w_k D'(u_k) du/dp(v_k) / D'(u(v)) - du/dp(v)) / u'(v),

which is none where all frames are alike. Every visit of a photo gives a Gauss-Newton step of both parameters, its path
free to follow. Once every photo has said something, the curve moves on by the step of all of them together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...numbers import number
from ...tone_curve import ToneCurve
from .slopes import Looked, sampled

Array = NDArray[np.float64]
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class ToneSettings:
    """When a curve is asked for, and how it moves."""

    visits: int = number(
        6,
        "visits",
        "of every photo, before it is asked for: paths have to be found first, and a twin that is soft still looks like"
        " less contrast (-0.15 after 3 visits, 0.1 at the end)",
        "a shelf in sRGB and with an S of 1.4, shaken by 4 to 14 px, seeds 0 and 1, with 3 visits",
        "the latter, seeds 2 and 3, and an orrery with film's shoulder: 0.06, 0.2 and 0.25 dB gained",
    )
    fewest: int = number(5, "photos", "whose path says something of it, or it stays sRGB's", _FIRST)
    prior: float = number(0.5, "of a slope", "standard deviation of toe and shoulder", _FIRST)
    off: float = number(
        0.1,
        "of a slope",
        "by which they are off whatever chance does, root mean square: a soft twin looks like less contrast",
        "shelf and ball in sRGB, ball with film's shoulder: 0 to 0.16, where chance leaves 0.01 to 0.02",
        "an orrery with film's shoulder: 0.01 and 0.11",
    )
    longest_step: float = number(0.2, "of a slope", "that toe and shoulder change by at a time", _FIRST)
    lowest: float = number(-0.5, "of a slope", "that they may be: the curve has to rise", _FIRST)
    highest: float = number(1.0, "of a slope", "that they may be: the curve has to rise", _FIRST)


SETTINGS = ToneSettings()


def slopes_in_curve(looked: Looked, rows: Tensor | None) -> Tensor:
    """[2, 3, h, w] of the photo (as it was filed) by the toe and by the shoulder of its camera's curve.

    Args:
        rows: [T, H + 2m, 1] or [T, 1, W + 2m] shares that frames have of the light of each row; None for even ones.
    """
    own, seen, count = looked.own, looked.seen, len(looked.exposed.frames)
    shares = torch.full((count, 1, 1), 1.0 / count) if rows is None else sampled(looked.exposed, rows, looked.at)
    light = own.decoding * shares[:, None]
    of_frames, of_photo = (looked.curve.parts(filed.values.clamp(0.0, 1.0)) for filed in (own, seen))
    parts = zip(of_frames, of_photo, strict=True)
    change = [(light * frame).sum(dim=0) / seen.decoding - photo for frame, photo in parts]
    return torch.stack(change) / seen.slope


class LearnedTone:
    """What the visits of the fitted photos say of the curve.

    Args:
        photos: how many are fitted; curve: to begin with.

    Attributes:
        curve: as it is now.
        error: standard errors of toe and shoulder, with what experience adds to them; None as long as nothing was
            found.
    """

    def __init__(self, photos: int, curve: ToneCurve = ToneCurve(), settings: ToneSettings = SETTINGS) -> None:
        self.settings, self.curve = settings, curve
        self.error: tuple[float, float] | None = None
        self._latest = np.full((photos, 6), np.nan)  # precision [2, 2] and vector [2] of each photo's last step
        self._visits = np.zeros(photos, np.int64)

    def see(self, photo: int, precision: Array, wanted: Array) -> None:
        """Keeps a photo's own step (`PathEquations.step_of`) in the place of its last one."""
        self._visits[photo] += 1
        self._latest[photo] = [*precision.ravel(), *wanted]

    def see_nothing(self, photo: int) -> None:
        """The same of a photo that stood still."""
        self.see(photo, np.zeros((2, 2)), np.zeros(2))

    @property
    def due(self) -> bool:
        """Whether all photos have said something since the curve moved last."""
        seen = bool(np.isfinite(self._latest).all()) and len(self._latest) > 0
        return seen and int(self._visits.min()) >= self.settings.visits

    def move(self) -> None:
        """Takes the curve on after a round of the photos; it stays where too few of them say anything."""
        s, now = self.settings, np.array([self.curve.toe, self.curve.shoulder])
        informed, whole = int(self._latest[:, 0].astype(bool).sum()), self._latest.sum(axis=0)
        self._latest[:] = np.nan
        if informed < s.fewest:
            return
        prior = np.eye(2) / s.prior**2
        precision = whole[:4].reshape(2, 2) + prior
        step = np.linalg.solve(precision, whole[4:] - prior @ now)
        toe, shoulder = np.sqrt(np.diag(np.linalg.inv(precision)))
        self.error = math.hypot(toe, s.off), math.hypot(shoulder, s.off)
        step = np.clip(step, -s.longest_step, s.longest_step)
        self.curve = ToneCurve(*(float(value) for value in np.clip(now + step, s.lowest, s.highest)))

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        error = (np.nan, np.nan) if self.error is None else self.error
        curve = np.array([self.curve.toe, self.curve.shoulder, *error])
        return {"tone.latest": self._latest.copy(), "tone.visits": self._visits.copy(), "tone.curve": curve}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        latest, visits, curve = (arrays.get(f"tone.{name}") for name in ("latest", "visits", "curve"))
        if latest is None or visits is None or curve is None or latest.shape != self._latest.shape:
            return False
        if visits.shape != self._visits.shape or curve.shape != (4,) or not np.isfinite(curve[:2]).all():
            return False
        self._latest, self._visits = np.array(latest, np.float64), np.array(visits, np.int64)
        self.curve = ToneCurve(float(curve[0]), float(curve[1]))
        self.error = (float(curve[2]), float(curve[3])) if np.isfinite(curve[2:]).all() else None
        return True
