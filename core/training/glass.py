"""The distance of frosted glass, learned with the Gaussians.

Where every photo was taken through the glass, the twin can take up any blur evenly: nothing shows how sharp the scene
is. What shows is how the blur differs with the depth. So the width at the scene's middle depth stays as it was given,
and the distance is learned; where some photos were taken without the glass, the width, too.

Whenever a photo is visited, it says by how much the two should change, the twin as it is (Gauss and Newton). For a
twin that fits the photos as well as it can, that is the slope of what it cannot fit (the envelope theorem): however
much of a wrong width it has taken up, the step points to where the photos agree best.
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

from ..forward import Exposed
from ..imaging.formation.glass import FrostedGlass
from ..numbers import BY_DEFINITION, number
from .gauss_newton import LookedAt, normal_equations, shown_with

Array = NDArray[np.float64]

#: What most of the numbers below rest on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class LearnedGlassSettings:
    """Numbers of the glass that is learned."""

    begin: float = number(0.4, "of the middle depth", "where the distance begins", _FIRST)
    learn_from: float = number(
        0.3, "share of the run", "from which on steps are taken: before, the twin is soft", _FIRST
    )
    nearest: float = number(0.95, "of the depth of what is nearest", "that the distance may reach", _FIRST)
    shown: float = number(
        0.05,
        "share",
        "standard error of a distance that points show, up to which it is not learned with the twin: what is asked of"
        " the distance",
        BY_DEFINITION,
    )
    points: int = number(2000, "count", "points that are looked at for what is nearest", _FIRST)
    stray: float = number(0.01, "share", "of the points that may be nearer than what counts as nearest: strays", _FIRST)
    part: float = number(0.5, "share of a step", "that is taken at each visit: the twin changes, too", _FIRST)
    ahead: float = number(
        2.0,
        "times",
        "as far as it has come of late the step goes beyond what the twin as it is fits best: it has taken up most of a"
        " wrong width, and gives it back slowly",
        "a rendered plane of 112 px and glass at 200 px, 300 steps: without it the distance was 30 and 10 % short",
    )
    forgets: float = number(0.05, "share", "of what the twin was trained with before, at a visit", _FIRST)
    longest_step: float = number(0.02, "of the middle depth", "of the distance at a visit", _FIRST)
    change: float = number(0.02, "of the middle depth", "of the distance, by which a slope is measured", BY_DEFINITION)
    independent: float = number(400.0, "px", "that a photo's px count as: neighbours err alike", _FIRST)
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count as their size (95 % efficient on normal noise)",
        BY_DEFINITION,
    )
    looked_at: int = number(20_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)


SETTINGS = LearnedGlassSettings()


class LearnedGlass:
    """Distance and width of a glass.

    Args:
        start: the effect in the scene's unit, where learning begins; `start.learned` says what is learned.

    Attributes:
        effect: as it is; the forward model's own, so that it sees every step.
    """

    def __init__(self, start: FrostedGlass, settings: LearnedGlassSettings = SETTINGS) -> None:
        self.settings, self.effect = settings, start
        self.middle = start.spread * (1.0 - start.distance)
        self._nearest = settings.nearest * min(start.scene.nearest, 1.0)
        self._normal: dict[str, tuple[Array, Array]] = {}
        self._before: Array | None = None  # what the twin has been trained with, of late

    def learn(self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None, share: float) -> None:
        """Takes a part of a step; arguments as of `CameraPaths.learn`; share: of the run."""
        s, effect = self.settings, self.effect
        if share < s.learn_from or effect.row_of(name) is None:
            return
        now = np.array([effect.distance, math.log(self.middle)])
        at = LookedAt.of(photo.shape[1], photo.shape[2], s)
        with torch.no_grad():
            still = exposed.degraded
            moved = [
                (shown_with(exposed, effect, self._with(*(now + np.eye(2)[k] * s.change)), at), s.change)
                for k in range(1 + ("spread" in effect.learned))
            ]
        matrix, vector = normal_equations(photo, still, moved, counts, s)
        used = len(vector)
        self._normal[name] = matrix, vector + matrix @ now[:used]
        together = sum((m for m, _ in self._normal.values()), np.zeros((used, used))) + 1e-9 * np.eye(used)
        target = sum((t for _, t in self._normal.values()), np.zeros(used))
        best = np.linalg.solve(together, target)
        if self._before is None:
            self._before = now[:used].copy()
        self._before += s.forgets * (now[:used] - self._before)
        step = s.part * (best + s.ahead * (best - self._before) - now[:used])
        if not np.isfinite(step).all():
            return
        errors = np.sqrt(np.diag(np.linalg.inv(together)))
        now[:used] += np.clip(step, -s.longest_step, s.longest_step)
        self._set(float(now[0]), float(now[1]), errors)

    def _with(self, distance: float, log_middle: float) -> FrostedGlass:
        """Another distance and width at the scene's unit of depth."""
        effect, like = self.effect, self.effect.parameters["distance"]
        spread = math.exp(log_middle) / (1.0 - distance)
        return FrostedGlass(like.new_tensor(spread), like.new_tensor(distance), effect.scene, effect.clear)

    def _set(self, distance: float, log_middle: float, errors: Array) -> None:
        distance = min(max(distance, 0.0), self._nearest)
        self.middle = math.exp(log_middle)
        spread = self.middle / (1.0 - distance)
        self.effect.parameters["distance"].fill_(distance)
        self.effect.parameters["spread"].fill_(spread)
        own = float(errors[1]) if len(errors) > 1 else 0.0
        self.effect.errors = spread * math.hypot(own, float(errors[0]) / (1.0 - distance)), float(errors[0])

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        names = list(self._normal)
        rows = [np.concatenate([m.ravel(), t]) for m, t in self._normal.values()]
        return {
            "glass": np.array([self.effect.distance, self.middle, *self.effect.errors]),
            "glass.before": np.zeros(0) if self._before is None else self._before,
            "glass.normal": np.array(rows),
            "glass.normal_of": np.array(names),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there."""
        if any(key not in arrays for key in ("glass", "glass.before", "glass.normal", "glass.normal_of")):
            return False
        distance, middle, *errors = (float(value) for value in arrays["glass"])
        self._set(distance, math.log(middle), np.zeros(1))
        self._before = arrays["glass.before"].copy() if len(arrays["glass.before"]) else None
        self.effect.errors = errors[0], errors[1]
        used = 1 + ("spread" in self.effect.learned)
        rows = dict(zip(arrays["glass.normal_of"].tolist(), arrays["glass.normal"], strict=True))
        self._normal = {
            name: (row[: used**2].reshape(used, used).copy(), row[used**2 :].copy()) for name, row in rows.items()
        }
        return True
