"""Short trainings with and without an effect, from the same seed, judged on photos that neither was trained on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...imaging.formation.chain import Formation
from ...imaging.medium import Medium
from ...lens import Lens
from ...pose import Pose
from ...progress import Silent
from ...training.grid import coarse_view
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
STEPS, GAUSSIANS, PAIRS = 100, 2000, 2
#: Trials see photos averaged down to so many px along the shorter side: what is tried changes from photo to photo, or
#: slowly over the frame and the depth, and shows there as well, at a price that does not grow with the photos.
SIDE = 80
#: A path must still be so many px long for a trial of it, the photos' middles are cut to this shorter side, and twins
#: must be sharp enough to tell: measured, with half of the steps paths of 6 px are not confirmed, and with half of the
#: side and of the Gaussians paths of 12 px on photos of 720 px are not.
SHOWN, CROP, KERNEL_STEPS, KERNEL_GAUSSIANS = 4.0, 200, 200, 6000
#: Sparse points that a trial of what the sensor does starts from at most.
POINTS = 1000
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
        return -float(stdtrit(max(1, len(self.differences) - 1), CHANCE))


class Ablation:
    """Pairs of trainings, and scores of what was already trained.

    Args:
        views: those of the training; held-out ones of the report take no part.
        points, settings: of the training; steps, Gaussians and points are cut down.
        medium: of the training. Effects of the sensor are tried without its blur: photos disagree about gains and
            corners as much when both twins stay soft, and fewer points do. What the light meets before the blur
            is tried through it, from all points: it goes by their depth.
    """

    def __init__(self, views: Sequence[View], points: SparsePoints, medium: Medium, settings: TrainingSettings) -> None:
        self.views, self.points = list(views), points
        self.step = max(1, min((min(v.camera.width, v.camera.height) for v in self.views), default=1) // SIDE)
        self._asked = settings
        self.settings = replace(
            settings,
            steps=min(STEPS, settings.steps),
            time_limit=None,
            until=None,
            min_steps=0,
            grid_step=None,
            max_gaussians=min(GAUSSIANS, settings.max_gaussians),
        )
        self._full, self.medium = medium, medium.on_grid(self.step)
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
        """`with_it` against `without`; `saturation` tells whether clipped px are masked without and with it.

        Photos of which no px counts are no part of it.
        """
        if without.kernels != with_it.kernels:
            arms = [Formation([e for e in f.effects if e.place != "sensor"]) for f in (without, with_it)]
            return self._finer(with_it, saturation[0])._compare(arms[0], arms[1], (False, False), through=True)
        return self._compare(without, with_it, saturation, bool(without.light or with_it.light))

    def _compare(
        self, without: Formation, with_it: Formation, saturation: tuple[bool, bool], through: bool
    ) -> Comparison:
        medium = self.medium if through else Medium()
        first, second = (self._scores(f, s, medium) for f, s in zip((without, with_it), saturation, strict=True))
        differences = second - first
        return Comparison(differences[np.isfinite(differences)])

    def _scores(self, formation: Formation, saturation: bool, medium: Medium) -> Array:
        """PSNR of every judged photo in dB, photos' own gains matched."""
        how = {"saturation": saturation, "through the blur": medium is self.medium}
        key = (*sorted(formation.names), *(word for word, true in how.items() if true))
        if key not in self._known:
            views = [self._coarse(view, medium) for view in corrected(self.views, formation, saturation)]
            self._known[key] = np.concatenate([self._of_pair(views, formation, medium, pair) for pair in range(PAIRS)])
        return self._known[key]

    def _of_pair(self, views: list[View], formation: Formation, medium: Medium, pair: int) -> list[float]:
        """Trains on what the pair does not judge, of `views`, and judges by photos as they were filed."""
        from ...training.scale import scene_scale

        blurred = medium is self.medium
        if blurred and formation.kernels:
            medium = formation.through(self._full, [v.name for v in self.views]).on_grid(self.step)

        settings = replace(self.settings, seed=self.settings.seed + 1000 + pair)
        judged = self.judged(pair)
        fitted = [view for i, view in enumerate(views) if i not in judged]
        points = self.points if blurred else _fewer(self.points)
        trained = train(fitted, [], points, medium, settings, Silent(), formation=formation)
        scale = scene_scale([view.camera for view in fitted], points)
        device = "cpu" if settings.device == "auto" else settings.device
        viewer = Viewer(trained.gaussians, scale, device, trained.low_pass, trained.background)
        scores = []
        filed = (replace(self.views[i], mask=_counted(self.views[i])) for i in judged)
        for view in (self._coarse(view, medium) for view in filed):
            c = view.camera
            lens = Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy))
            shown = viewer.degraded(lens, Pose(c.rotation, c.translation), medium, view.name, formation)
            scores.append(matched_psnr(shown, view.planes(), view.mask))
        return scores

    def _finer(self, formation: Formation, saturation: bool) -> Ablation:
        """Trials on the middles of photos averaged down less, as what a kernel does is small; the sensor is undone."""
        step = max(1, min(self.step, int(min([SHOWN * self.step, *(e.finest for e in formation.kernels)]) / SHOWN)))
        views = corrected(self.views, formation, saturation)
        other = Ablation([cropped(view, step * CROP) for view in views], self.points, self._full, self.settings)
        other.step, other.medium = step, self._full.on_grid(step)
        steps, most = min(KERNEL_STEPS, self._asked.steps), min(KERNEL_GAUSSIANS, self._asked.max_gaussians)
        other.settings = replace(self.settings, steps=steps, max_gaussians=most)
        return other

    def _coarse(self, view: View, medium: Medium) -> View:
        return coarse_view(view, self.step, medium.blur_space)


def cropped(view: View, side: int) -> View:
    """The middle of a view, whose shorter side is `side` px at most; the very same one where it is no larger."""
    camera = view.camera
    share = side / min(camera.width, camera.height)
    if share >= 1.0:
        return view
    width, height = round(camera.width * share), round(camera.height * share)
    left, top = (camera.width - width) // 2, (camera.height - height) // 2
    inside = (slice(top, top + height), slice(left, left + width))
    camera = replace(camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top)
    mask = None if view.mask is None else np.ascontiguousarray(view.mask[inside])
    return replace(view, camera=camera, photo=np.ascontiguousarray(view.photo[inside]), mask=mask)


def _fewer(points: SparsePoints) -> SparsePoints:
    """At most `POINTS` of them, evenly through the list."""
    if len(points.positions) <= POINTS:
        return points
    kept = np.linspace(0, len(points.positions) - 1, POINTS).round().astype(int)
    return SparsePoints(points.positions[kept], points.colours[kept])


def _counted(view: View) -> NDArray[np.bool_] | None:
    """Px that count: those of the mask that are not clipped, whatever the arm."""
    top = int(np.iinfo(view.photo.dtype).max)
    clear = ~(view.photo >= top - top // (view.levels or top)).any(axis=2)
    return clear if view.mask is None else clear & view.mask
