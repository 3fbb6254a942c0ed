"""The distance of frosted glass, and how it leans, learned with the Gaussians.

Where every photo was taken through the glass, the twin can take up any blur evenly: nothing shows how sharp the scene
is. What shows is how the blur differs with the depth. So the width at the scene's middle depth stays as it was given,
and the distance is learned; where some photos were taken without the glass, the width, too. A glass that may lean is
met nearer on one side of the frame than on the other: its two angles are learned alike. Of a glass that stands in the
world distance and angles are those before one of the cameras, and follow for all others.

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

from ...forward import Exposed
from ...glass import STEEPEST_TILT
from ...imaging.formation.glass import FrostedGlass
from ...numbers import BY_DEFINITION, number
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
    steepest: float = number(
        math.tan(math.radians(STEEPEST_TILT)), "tangent", "of the angle by which a glass may lean", BY_DEFINITION
    )
    looked_at: int = number(20_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)


SETTINGS = LearnedGlassSettings()


class LearnedGlass:
    """Distance of a glass, its width, and how it leans.

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
        #: Which of distance, logarithm of the width, and the two tangents of the tilt are learned.
        self._free = [0, *([1] if "spread" in start.learned else []), *([2, 3] if "tilt" in start.learned else [])]

    def learn(self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None, share: float) -> None:
        """Takes a part of a step; arguments as of `CameraPaths.learn`; share: of the run."""
        s, effect = self.settings, self.effect
        if share < s.learn_from or effect.row_of(name) is None:
            return
        now = np.array([effect.distance, math.log(self.middle), *effect.tilt])
        at, free = LookedAt.of(photo.shape[1], photo.shape[2], s), self._free
        with torch.no_grad():
            still = exposed.degraded
            moved = [
                (shown_with(exposed, effect, self._with(*(now + np.eye(len(now))[k] * s.change)), at), s.change)
                for k in free
            ]
        matrix, vector = normal_equations(photo, still, moved, counts, s)
        self._normal[name] = matrix, vector + matrix @ now[free]
        none = np.zeros((len(free), len(free)))
        together = sum((m for m, _ in self._normal.values()), none) + 1e-9 * np.eye(len(free))
        target = sum((t for _, t in self._normal.values()), np.zeros(len(free)))
        best = np.linalg.solve(together, target)
        if self._before is None:
            self._before = now[free].copy()
        self._before += s.forgets * (now[free] - self._before)
        step = s.part * (best + s.ahead * (best - self._before) - now[free])
        if not np.isfinite(step).all():
            return
        errors = np.zeros(len(now))
        errors[free] = np.sqrt(np.diag(np.linalg.inv(together)))
        now[free] += np.clip(step, -s.longest_step, s.longest_step)
        self._set(*now, errors=errors)

    def _with(self, distance: float, log_middle: float, *tilt: float) -> FrostedGlass:
        """Another distance, width at the scene's unit of depth, and tilt."""
        effect, like = self.effect, self.effect.parameters["distance"]
        spread = math.exp(log_middle) / (1.0 - distance)
        lean = like.new_tensor(tilt) if "tilt" in effect.parameters else None
        return FrostedGlass(like.new_tensor(spread), like.new_tensor(distance), effect.scene, effect.clear, tilt=lean)

    def _set(self, distance: float, log_middle: float, *tilt: float, errors: Array) -> None:
        distance = min(max(distance, 0.0), self._nearest)
        self.middle = math.exp(log_middle)
        spread = self.middle / (1.0 - distance)
        effect = self.effect
        effect.parameters["distance"].fill_(distance)
        effect.parameters["spread"].fill_(spread)
        if "tilt" in effect.parameters:
            steepest = self.settings.steepest
            effect.parameters["tilt"].copy_(torch.tensor([min(max(lean, -steepest), steepest) for lean in tilt]))
            effect.tilt_errors = float(errors[2]), float(errors[3])
        effect.errors = spread * math.hypot(float(errors[1]), float(errors[0]) / (1.0 - distance)), float(errors[0])

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        names, effect = list(self._normal), self.effect
        rows = [np.concatenate([m.ravel(), t]) for m, t in self._normal.values()]
        return {
            "glass": np.array([effect.distance, self.middle, *effect.errors, *effect.tilt, *effect.tilt_errors]),
            "glass.before": np.zeros(0) if self._before is None else self._before,
            "glass.normal": np.array(rows),
            "glass.normal_of": np.array(names),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there."""
        if any(key not in arrays for key in ("glass", "glass.before", "glass.normal", "glass.normal_of")):
            return False
        distance, middle, *kept = (float(value) for value in arrays["glass"])
        self._set(distance, math.log(middle), *kept[2:4], errors=np.zeros(4))
        self._before = arrays["glass.before"].copy() if len(arrays["glass.before"]) else None
        self.effect.errors, self.effect.tilt_errors = (kept[0], kept[1]), (kept[4], kept[5])
        used = len(self._free)
        rows = dict(zip(arrays["glass.normal_of"].tolist(), arrays["glass.normal"], strict=True))
        self._normal = {
            name: (row[: used**2].reshape(used, used).copy(), row[used**2 :].copy()) for name, row in rows.items()
        }
        return True
