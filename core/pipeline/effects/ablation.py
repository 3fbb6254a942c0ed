"""Short trainings with and without an effect, from the same seed, judged on photos that neither was trained on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ...imaging.formation.chain import Formation
from ...imaging.medium import Medium
from ...lens import Lens
from ...progress import Silent
from ...sfm.reconstruction import Pose
from ...training.run import train
from ...training.settings import TrainingSettings
from ...views import SparsePoints, View
from ..views import Viewer
from .corrected import corrected
from .matched import matched_psnr

Array = NDArray[np.float64]

#: Every so many photos of the training's own is judged by a pair of trainings without it, others by the next pair;
#: at least so many in all, and at most so many by a pair.
EVERY, FEWEST, MOST = 4, 5, 8
#: A short training, and pairs of them, each with a seed and judged photos of its own.
STEPS, GAUSSIANS, PAIRS = 250, 15_000, 2
#: An effect is confirmed where chance would give its gain less often than a normal's two standard errors do.
CHANCE = 0.0228


@dataclass(frozen=True)
class Comparison:
    """Paired differences (dB), one for each judged photo."""

    differences: Array

    @property
    def mean(self) -> float:
        """Mean gain, dB."""
        return float(self.differences.mean())

    @property
    def error(self) -> float:
        """Standard error of `mean`."""
        count = len(self.differences)
        return float(self.differences.std(ddof=1) / math.sqrt(count)) if count > 1 else math.inf

    @property
    def confirms(self) -> bool:
        """Whether the gain is more than chance."""
        return self.mean > self.needed * self.error

    @property
    def needed(self) -> float:
        """Standard errors that a gain must exceed: 2 with many photos, more with few (Student's t)."""
        return float(stats.t.isf(CHANCE, max(1, len(self.differences) - 1)))


class Ablation:
    """Pairs of trainings, and scores of what was already trained.

    Args:
        views: those of the training; held-out ones of the report take no part.
        points, medium, settings: of the training; steps and Gaussians are cut down.
    """

    def __init__(
        self, views: Sequence[View], points: SparsePoints, medium: Medium, settings: TrainingSettings
    ) -> None:
        self.views, self.points, self.medium = list(views), points, medium
        self.settings = replace(
            settings, steps=min(STEPS, settings.steps), time_limit=None,
            max_gaussians=min(GAUSSIANS, settings.max_gaussians),
        )  # fmt: skip
        self._known: dict[tuple[str, ...], Array] = {}

    def judged(self, pair: int) -> list[int]:
        """Which photos a pair of trainings is judged by."""
        found = list(range((1 + pair * (EVERY // PAIRS)) % EVERY, len(self.views), EVERY))
        return [found[i] for i in np.linspace(0, len(found) - 1, min(MOST, len(found))).round().astype(int)]

    @property
    def possible(self) -> bool:
        """Whether there are photos enough to judge by."""
        return sum(len(self.judged(pair)) for pair in range(PAIRS)) >= FEWEST

    def compare(
        self, without: Formation, with_it: Formation, saturation: tuple[bool, bool] = (False, False)
    ) -> Comparison:
        """`with_it` against `without`; `saturation` tells whether clipped px are masked without and with it."""
        first, second = (self._scores(f, s) for f, s in zip((without, with_it), saturation, strict=True))
        return Comparison(second - first)

    def _scores(self, formation: Formation, saturation: bool) -> Array:
        """PSNR of every judged photo in dB, photos' own gains matched."""
        key = (*sorted(formation.names), *(["saturation"] if saturation else []))
        if key not in self._known:
            self._known[key] = np.concatenate([self._of_pair(formation, saturation, pair) for pair in range(PAIRS)])
        return self._known[key]

    def _of_pair(self, formation: Formation, saturation: bool, pair: int) -> list[float]:
        settings = replace(self.settings, seed=self.settings.seed + 1000 + pair)
        judged = self.judged(pair)
        fitted = [view for i, view in enumerate(self.views) if i not in judged]
        views = corrected(fitted, formation, saturation)
        trained = train(views, [], self.points, self.medium, settings, Silent(), formation=formation)
        from ...training.scale import scene_scale

        scale = scene_scale([view.camera for view in fitted], self.points)
        device = "cpu" if settings.device == "auto" else settings.device
        viewer = Viewer(trained.gaussians, scale, device, trained.low_pass, trained.background)
        scores = []
        for view in (self.views[i] for i in judged):
            c = view.camera
            lens = Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy))
            shown = viewer.degraded(lens, Pose(c.rotation, c.translation), self.medium, view.name, formation)
            scores.append(matched_psnr(shown, view.planes(), _counted(view)))
        return scores


def _counted(view: View) -> NDArray[np.bool_] | None:
    """Px that count: those of the mask that are not clipped, whatever the arm."""
    top = int(np.iinfo(view.photo.dtype).max)
    clear = ~(view.photo >= top - top // (view.levels or top)).any(axis=2)
    return clear if view.mask is None else clear & view.mask
