"""Which photo to take next: ranks candidate cameras by what they are expected to tell about a twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..errors import Cancelled
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..training.grid import coarse_camera
from ..twin.folder import Twin
from .coverage import Coverage
from .gain import Gain, gain_of
from .looks import Looks, Place
from .posterior import Posterior, sample_posterior

#: Long side in px of the grid that gains are computed on at most: what a view tells changes slowly.
GRID = 320
#: Candidates that stand for where the twin may be looked at from, at most.
WANTED = 48


@dataclass(frozen=True)
class NextViewSettings:
    """Effort and assumptions.

    Attributes:
        count: how many views to choose one after the other, each knowing those before it.
        samples, iterations: of `sample_posterior`.
        through_blur: False ranks as if the medium were clear (for comparison).
        seed: of the samples.
    """

    count: int = 3
    samples: int = 6
    iterations: int = 8
    through_blur: bool = True
    seed: int = 0


@dataclass(frozen=True)
class Suggestion:
    """A candidate: its gain given the photos that are there, the share of what may be looked at that it newly covers
    (given those chosen before it, too), and `order` 1, 2, ... for the chosen ones, None for the others."""

    camera: Camera
    gain: Gain
    covers: float
    order: int | None

    def plain(self) -> dict[str, Any]:
        """For JSON: world to camera, px."""
        c = self.camera
        return {
            "name": c.name, "order": self.order, "covers": round(self.covers, 5), **asdict(self.gain),
            "centre": c.centre.tolist(),
            "rotation": c.rotation.tolist(), "translation": c.translation.tolist(),
            "width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy,
        }  # fmt: skip


class Knowledge:
    """What a twin's photos say about it, on one grid.

    Args:
        twin: the twin; `through_blur` False leaves the point spread out.
    """

    def __init__(self, twin: Twin, through_blur: bool = True, grid: int = GRID) -> None:
        camera = twin.views[0].camera
        self.twin = twin
        self.step = max(twin.step, -(-max(camera.width, camera.height) // grid))
        self.margin = twin.margin(self.step)
        gaussians = twin.scale.to_unit(twin.gaussians)
        kept = twin.kept or twin.views
        views = twin.on_grid(kept, self.step)
        self.taken = [
            Place(v.camera, v.psf if through_blur else None, None if v.valid is None else torch.from_numpy(v.valid))
            for v in views
        ]
        settings = RasterSettings(low_pass=max(0.1, 0.3 / self.step**2))
        self.looks = Looks(gaussians, self.taken, self.margin, twin.background, settings)
        self.through_blur = through_blur
        self.noise = self._residual(views)

    def _residual(self, views: Sequence[Any]) -> float:
        """Root mean square of the photos' residuals: noise and what the twin cannot follow, together.

        It scales all that follows from the photos, so that no truth is needed; rounding is the least there can be.
        """
        errors = []
        for view in views[:: max(1, len(views) // 12)]:
            place = Place(view.camera, view.psf)
            error = (self.looks.photo(place) - torch.from_numpy(view.planes())).square()
            errors.append(float(error.mean() if view.valid is None else error[:, torch.from_numpy(view.valid)].mean()))
        return max(float(np.sqrt(np.mean(errors))), 1.0 / 255.0 / 12.0**0.5)

    def place(self, camera: Camera) -> Place:
        """A candidate in world units, on the grid."""
        unit = coarse_camera(self.twin.scale.camera_to_unit(camera), self.step)
        psf = self.twin.medium.psf if self.through_blur else None
        return Place(unit, None if psf is None or psf.is_identity else psf.on_grid(self.step))

    def posterior(self, taken: Sequence[Place], settings: NextViewSettings, progress: Progress) -> Posterior:
        """What `taken` leave open."""
        def told(done: int) -> None:
            progress.advance(done)
            if progress.cancelled():
                raise Cancelled("Stopped while weighing what the photos say")

        return sample_posterior(
            self.looks, taken, self.noise, settings.samples, settings.iterations, settings.seed, told
        )  # fmt: skip


@dataclass(frozen=True)
class Ranking:
    """Suggestions, the chosen ones first, and how much [N] of each Gaussian's colour the photos fix (0 to 1)."""

    suggestions: list[Suggestion]
    known: Tensor


def rank(twin: Twin, candidates: Sequence[Camera], settings: NextViewSettings, progress: Progress) -> Ranking:
    """Chooses `settings.count` candidates greedily; the rest follow by their gain after those.

    Args:
        candidates: in world units; those from which nothing of the twin is seen gain nothing.
    """
    knowledge = Knowledge(twin, settings.through_blur)
    places = {camera.name: knowledge.place(camera) for camera in candidates}
    left = {camera.name: camera for camera in candidates}
    progress.stage("information", settings.samples)
    posterior = knowledge.posterior(knowledge.taken, settings, progress)
    progress.stage("candidates", len(left))
    wanted = list(places.values())[:: max(1, -(-len(places) // WANTED))]
    coverage = Coverage(knowledge.looks, knowledge.noise, wanted, settings.seed)
    for place in knowledge.taken:
        coverage.take(place)
    gains, covers = {}, {}
    for done, (name, place) in enumerate(places.items()):
        gains[name] = gain_of(knowledge.looks, posterior, knowledge.taken, place)
        covers[name] = coverage.gain(place)
        progress.advance(done + 1)
        if progress.cancelled():
            raise Cancelled("Stopped while weighing the candidates")
    chosen = []
    for order in range(1, min(settings.count, len(candidates)) + 1):
        best = max(left, key=lambda name: covers[name])
        chosen.append(Suggestion(left.pop(best), gains[best], covers[best], order))
        coverage.take(places[best])
        covers = {name: coverage.gain(places[name]) for name in left}
    rest = [Suggestion(camera, gains[name], covers[name], None) for name, camera in left.items()]
    return Ranking(chosen + sorted(rest, key=lambda s: -s.covers), posterior.known())
