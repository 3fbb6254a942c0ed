"""Which photo to take next: ranks candidate cameras by what they are expected to add about a twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..errors import Cancelled
from ..forward import low_pass_on_grid
from ..forward.compare import mask_of, mean_square
from ..numbers import number
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..training.grid import coarse_camera
from ..twin.opened import OpenedTwin
from .coverage import Coverage
from .detail import Detail
from .expected_error import PARTS, ExpectedError
from .information_gain import InformationGain, gain_of, observed_share, opened, spread
from .linear_model import LinearModel, Viewpoint
from .posterior import Posterior, sample_posterior


@dataclass(frozen=True)
class NextViewLimits:
    """What bounds the time: more of each changes the ranking little."""

    grid: int = number(320, "px", "long side of the grid for gains, at most: what a view adds changes slowly")
    wanted: int = number(48, "count", "candidates that stand for where the twin may be looked at from, at most")
    held: int = number(
        8, "count", "held-out photos that measure the expected error, at most: each costs as much as a candidate"
    )
    residual_photos: int = number(12, "count", "photos that noise and contrast are read from, at most")


LIMITS = NextViewLimits()


@dataclass(frozen=True)
class NextViewSettings:
    """Effort and assumptions.

    Attributes:
        count: how many views to choose one after the other, each given those before it.
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
    """A candidate.

    Attributes:
        gain: given the photos that are there.
        covers: share of the detail that may be looked at that it newly resolves, given those chosen before it, too.
        error: expected rms error of the twin's sharp view there, sRGB in [0, 1].
        order: 1, 2, ... for the chosen ones, None for the others.
    """

    camera: Camera
    gain: InformationGain
    covers: float
    error: float
    order: int | None

    def plain(self) -> dict[str, Any]:
        """For JSON: world to camera, px."""
        c = self.camera
        return {
            "name": c.name,
            "order": self.order,
            "covers": round(self.covers, 5),
            "expected_error": round(self.error, 5),
            **asdict(self.gain),
            "centre": c.centre.tolist(),
            "rotation": c.rotation.tolist(),
            "translation": c.translation.tolist(),
            "width": c.width,
            "height": c.height,
            "fx": c.fx,
            "fy": c.fy,
            "cx": c.cx,
            "cy": c.cy,
        }


class Observations:
    """A twin's photos, their viewpoints, noise and linear model, on one grid.

    Args:
        twin: the twin; `through_blur` False leaves the point spread out.
    """

    def __init__(self, twin: OpenedTwin, through_blur: bool = True, grid: int = LIMITS.grid) -> None:
        camera = twin.views[0].camera
        self.twin = twin
        self.step = max(twin.step, -(-max(camera.width, camera.height) // grid))
        self.margin = twin.margin(self.step)
        gaussians = twin.scale.to_unit(twin.gaussians)
        kept = twin.kept or twin.views
        self.views = views = twin.on_grid(kept, self.step)
        self.taken = [
            Viewpoint(v.camera, v.psf if through_blur else None, None if v.valid is None else torch.from_numpy(v.valid))
            for v in views
        ]
        settings = RasterSettings(low_pass=low_pass_on_grid(self.step))
        self.linear = LinearModel(gaussians, self.taken, self.margin, twin.background, settings)
        self.through_blur = through_blur
        self.noise = self._residual(views)

    def _residual(self, views: Sequence[Any]) -> float:
        """Root mean square of the photos' residuals: noise and what the twin cannot follow, together.

        It scales all that follows from the photos, so that no truth is needed; rounding is the least there can be.
        """
        errors = []
        for view in views[:: max(1, len(views) // LIMITS.residual_photos)]:
            viewpoint = Viewpoint(view.camera, view.psf)
            residual = torch.from_numpy(view.planes()) - self.linear.photo(viewpoint)
            errors.append(mean_square(residual, mask_of(view.valid)))
        return max(float(np.sqrt(np.mean(errors))), 1.0 / 255.0 / 12.0**0.5)

    def viewpoint(self, camera: Camera) -> Viewpoint:
        """A candidate in world units, on the grid.

        Where photos have blurs of their own, a candidate's is taken for that of the photo next to it.
        """
        unit = coarse_camera(self.twin.scale.camera_to_unit(camera), self.step)
        medium = self.twin.medium
        psf = medium.psf
        if medium.per_view:
            nearest = min(self.twin.views, key=lambda v: float(np.linalg.norm(v.camera.centre - camera.centre)))
            psf = medium.psf_for(nearest.name)
        psf = psf if self.through_blur else None
        return Viewpoint(unit, None if psf is None or psf.is_identity else psf.on_grid(self.step))

    def held(self) -> list[tuple[Viewpoint, Tensor]]:
        """Places and photos [3, H, W] that the twin was not trained on."""
        names = set(self.twin.held)
        views = self.twin.on_grid([v for v in self.twin.views if v.name in names], self.step) if self.twin.kept else []
        return [
            (
                Viewpoint(
                    v.camera,
                    v.psf if self.through_blur else None,
                    None if v.valid is None else torch.from_numpy(v.valid),
                ),
                torch.from_numpy(v.planes()),
            )
            for v in views[:: max(1, -(-len(views) // LIMITS.held))]
        ]

    def contrast(self) -> float:
        """Variance of the photos' px, sRGB^2."""
        some = self.views[:: max(1, len(self.views) // LIMITS.residual_photos)]
        return float(np.mean([view.planes().var(axis=(1, 2)).mean() for view in some]))

    def posterior(self, taken: Sequence[Viewpoint], settings: NextViewSettings, progress: Progress) -> Posterior:
        """What `taken` leave open."""

        def on_sample(done: int) -> None:
            progress.advance(done)
            if progress.cancelled():
                raise Cancelled("Stopped while weighing what the photos say")

        return sample_posterior(
            self.linear, taken, self.noise, settings.samples, settings.iterations, settings.seed, on_sample
        )


@dataclass(frozen=True)
class Ranking:
    """Suggestions, the chosen ones first.

    Attributes:
        determined: [N] how much of each Gaussian's colour the photos fix (0 to 1).
        error: how the expected errors were measured, for JSON; 'contrast' is the photos' own rms, sRGB.
        views: of the chosen ones by name, what the twin shows there ([3, H, W], sharp, sRGB, on the grid), how wrong
            it is expected to be ([H, W], rms), and how far photos determine it ([H, W], see `observed_share`).
    """

    suggestions: list[Suggestion]
    determined: Tensor
    error: dict[str, Any]
    views: dict[str, tuple[Tensor, Tensor, Tensor]]


def rank(twin: OpenedTwin, candidates: Sequence[Camera], settings: NextViewSettings, progress: Progress) -> Ranking:
    """Chooses `settings.count` candidates greedily; the rest follow by what they are worth after those.

    Args:
        candidates: in world units; those from which nothing of the twin is seen gain nothing.
    """
    observations = Observations(twin, settings.through_blur)
    linear, taken = observations.linear, observations.taken
    viewpoints = {camera.name: observations.viewpoint(camera) for camera in candidates}
    left = {camera.name: camera for camera in candidates}
    progress.stage("information", settings.samples)
    posterior = observations.posterior(taken, settings, progress)
    progress.stage("candidates", len(left))
    wanted = list(viewpoints.values())[:: max(1, -(-len(viewpoints) // LIMITS.wanted))]
    detail = Detail(linear, observations.noise, wanted, taken)
    coverage = Coverage(detail, wanted, taken, settings.seed)
    expected = ExpectedError(detail, posterior, taken, observations.contrast())
    held = observations.held()
    expected.fit(held)
    gains, covers, errors = {}, {}, {}
    for done, (name, viewpoint) in enumerate(viewpoints.items()):
        spreads = spread(linear, opened(linear, posterior, taken, viewpoint), viewpoint)
        gains[name] = gain_of(linear, posterior, taken, viewpoint, spreads)
        errors[name] = float(expected.deviation(viewpoint, spreads).square().mean().sqrt())
        covers[name] = coverage.gain(viewpoint)
        progress.advance(done + 1)
        if progress.cancelled():
            raise Cancelled("Stopped while weighing the candidates")
    chosen = []
    scores = coverage.scores(list(viewpoints.values()))
    for order in range(1, min(settings.count, len(candidates)) + 1):
        best = list(left)[int(np.argmax(scores))]
        chosen.append(Suggestion(left.pop(best), gains[best], covers[best], errors[best], order))
        coverage.take(viewpoints[best])
        covers = {name: coverage.gain(viewpoints[name]) for name in left}
        scores = coverage.scores([viewpoints[name] for name in left])
    ranked = sorted(zip(scores, left.items(), strict=True), key=lambda pair: -pair[0])
    rest = [Suggestion(camera, gains[name], covers[name], errors[name], None) for _, (name, camera) in ranked]
    weights = {name: round(float(w), 5) for name, w in zip(PARTS, expected.weights, strict=True)}
    measured = {"held_photos": len(held), "contrast": round(observations.contrast() ** 0.5, 5), "weights": weights}
    views = {}
    for name in (s.camera.name for s in chosen):
        views[name] = (*expected.view(viewpoints[name]), observed_share(linear, posterior, taken, viewpoints[name]))
    return Ranking(chosen + rest, posterior.determined(), measured, views)
