"""Cameras and Gaussians found together: the photos' own loss, through the blur, moves the cameras too.

By turns a twin is trained shortly, each photo is aligned with the twin's own blurred view (`consensus`), and all
cameras move to where their photos see it (`adjust`). Then a short training runs twice from the same seed: with the
cameras as they were, and with the refined ones. The refined ones are kept only if the photos then lie on their twin's
views clearly better, and if photos that neither trained on, aligned where they fit best, are not explained worse.

Blurred photos' brightness alone is no judge: where cameras of a real set were off by 2 px, it did not show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import Cancelled
from ..evaluation.poses import align_similarity
from ..forward.compare import mask_of, mean_square
from ..imaging.medium import Medium
from ..numbers import number
from ..progress import Progress
from ..training.cameras.bundle import adjusted
from ..training.cameras.gauge import as_first_seen
from ..training.grid import GridView, coarse_camera
from ..training.level import Level
from ..training.settings import TrainingSettings
from ..training.trainer import Trainer
from ..views import SparsePoints, View
from .consensus import align_view, disagreement, observations, shown

#: What the docs' tables of refined cameras were made with.
_BASIN = "ball (rendered) and copr, cameras shaken by 1 to 6 px (docs/twin.md)"


@dataclass(frozen=True)
class CameraRefinementSettings:
    """Of the refinement of cameras by a twin."""

    judges_every: int = number(8, "count", "every so many photos judges where none is held out")
    steps: int = number(
        300, "count", "iterations of the trainings that judge; cameras need the shape, not the last detail"
    )
    max_gaussians: int = number(15_000, "count", "splats of the short trainings; more take longer for detail unused")
    rounds: int = number(
        3,
        "count",
        "steps of the cameras, each after a training of its own from nothing: a twin that was fitted to wrong cameras"
        " keeps them wrong",
        _BASIN,
    )
    round_steps: int = number(200, "count", "iterations of each round's training", _BASIN)
    clearly_nearer: float = number(
        0.8,
        "factor",
        "photos must lie nearer to their twin's views by this: good cameras of four sets gave 0.99 to 1.06, cameras"
        " that were off by 2 px 0.17 to 0.52",
        _BASIN,
        "sharp photos of copr, brighton, banana: left alone, at 0.94 to 1.04",
    )
    smallest_shift: float = number(0.02, "px", "shifts below this are no shifts")
    observations_per_photo: int = number(
        20, "count", "observations that photos must have on average; with fewer the cameras stay"
    )


SETTINGS = CameraRefinementSettings()


@dataclass(frozen=True)
class Refined:
    """What came out.

    Attributes:
        kept: whether the refined cameras were taken.
        cameras: by name, all views', world units: the refined ones if kept, else those that came in.
        tried: the refined ones, kept or not.
        focal_change: refined over given focal length, less 1.
        moved_px: median of how far the cameras moved, px at the scene's distance, after taking out the gauge.
        loss_before, loss_after: mean of the judges' squared residual, in 8-bit steps squared.
        error: standard error of the judges' mean difference, in the same unit.
        shift_before, shift_after: px by which photos lie off their twin's views (median).
        shift_change, shift_error: mean change of its natural logarithm, photo by photo, and its standard error.
        judges: names.
    """

    kept: bool
    cameras: dict[str, Camera]
    tried: dict[str, Camera]
    focal_change: float
    moved_px: float
    loss_before: float
    loss_after: float
    error: float
    shift_before: float | None
    shift_after: float | None
    shift_change: float
    shift_error: float | None
    judges: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """For report.json."""
        content = asdict(replace(self, cameras={}, tried={}))
        return {name: value for name, value in content.items() if name not in ("cameras", "tried")}


def refine_cameras(
    views: Sequence[View],
    judges: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    settings: TrainingSettings,
    progress: Progress,
    focal: bool = True,
) -> Refined:
    """Refines the cameras of `views` and `judges`.

    Args:
        views: photos to fit; judges: photos to judge by, if empty every 8th view.
        settings: seed, threads and loss are taken over, effort is not.
        focal: whether the shared focal length may change.

    Raises:
        Cancelled: the user asked to stop.
    """
    if not judges:
        judges = views[:: SETTINGS.judges_every]
        views = [view for index, view in enumerate(views) if index % SETTINGS.judges_every]
    most = min(settings.max_gaussians, SETTINGS.max_gaussians)
    short = replace(settings, steps=SETTINGS.steps, max_gaussians=most, time_limit=None)
    losses, cameras, placed, shifts = [], [], [], []
    moved = list(views)
    for moving in (False, True):
        if moving:
            moved = _agreed(views, points, medium, short, focal, progress)
        trainer = _trained(moved, points, medium, short, "refined cameras" if moving else "cameras as found", progress)
        aligner = ViewAligner(trainer)
        judged = [aligner.judged(view) for view in judges]
        losses.append(np.array([loss for loss, _ in judged]) * 255.0**2)
        placed.append({view.name: camera for view, (_, camera) in zip(judges, judged, strict=True)})
        cameras.append({view.name: view.camera for view in moved})
        shifts.append(disagreement(trainer))
    gain = losses[0] - losses[1]
    error = float(gain.std(ddof=1) / len(gain) ** 0.5) if len(gain) > 1 else float("inf")
    nearer = Nearer.of(*shifts)
    kept = nearer.clear and float(gain.mean()) > -2.0 * error
    given = {view.name: view.camera for view in [*views, *judges]}
    tried = {**cameras[1], **placed[1]}
    ratio = cameras[1][views[0].name].fx / views[0].camera.fx
    return Refined(
        kept,
        tried if kept else given,
        tried,
        float(ratio - 1.0),
        _moved_px(views, cameras[1], trainer.scale.size),
        float(losses[0].mean()),
        float(losses[1].mean()),
        error,
        _median(shifts[0]),
        _median(shifts[1]),
        nearer.change,
        nearer.error if np.isfinite(nearer.error) else None,
        tuple(view.name for view in judges),
    )


def _moved_px(views: Sequence[View], cameras: Mapping[str, Camera], distance: float) -> float:
    """px at a distance, median, between the centres of cameras and those of the views, without the world's own move."""
    still = align_similarity(cameras, {view.name: view.camera for view in views})
    off = [still.points(cameras[view.name].centre) - view.camera.centre for view in views]
    return float(np.median([np.linalg.norm(o) / distance * v.camera.fx for o, v in zip(off, views, strict=True)]))


@dataclass(frozen=True)
class Nearer:
    """Whether photos lie nearer to their twin's views: mean change of the shifts' logarithm, and its error."""

    change: float
    error: float

    @staticmethod
    def of(before: NDArray[np.float64], after: NDArray[np.float64]) -> Nearer:
        """From [V] px each; photos that could not be aligned are NaN."""
        least = SETTINGS.smallest_shift
        change = np.log(np.maximum(after, least) / np.maximum(before, least))
        change = change[np.isfinite(change)]
        if len(change) < 3:
            return Nearer(0.0, float("inf"))
        return Nearer(float(change.mean()), float(change.std(ddof=1) / len(change) ** 0.5))

    @property
    def clear(self) -> bool:
        """Nearer by a fifth at least, and by more than chance."""
        return bool(self.change < min(np.log(SETTINGS.clearly_nearer), -3.0 * self.error))


def _median(px: NDArray[np.float64]) -> float | None:
    return float(np.nanmedian(px)) if np.isfinite(px).any() else None


def _trained(
    views: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    settings: TrainingSettings,
    stage: str,
    progress: Progress,
) -> Trainer:
    """A short training to its end."""
    progress.stage(stage, settings.steps)
    trainer = Trainer(views, [], points, medium, settings)
    for step in range(settings.steps):
        trainer.advance(step / settings.steps)
        if step % 10 == 0:
            progress.advance(step)
            if progress.cancelled():
                raise Cancelled("Stopped while refining the cameras")
    return trainer


def _agreed(
    views: Sequence[View],
    points: SparsePoints,
    medium: Medium,
    settings: TrainingSettings,
    focal: bool,
    progress: Progress,
) -> list[View]:
    """The views with the cameras that their photos agree on, the world where the cameras saw it at first."""
    short = replace(settings, steps=SETTINGS.round_steps)
    began, views = [view.camera for view in views], list(views)
    for index in range(SETTINGS.rounds):
        stage = f"cameras by the loss, {index + 1} of {SETTINGS.rounds}"
        trainer = _trained(views, points, medium, short, stage, progress)
        level = trainer.levels[-1]
        before = [view.camera for view in level.views]
        surface, seen = observations(trainer, settings.seed + index)
        if len(seen) < SETTINGS.observations_per_photo * len(views):
            break  # the photos show too little in common; the judges decide on what there is
        found = adjusted(before, surface, seen, focal)
        first = [coarse_camera(trainer.scale.camera_to_unit(camera), level.step) for camera in began]
        still = as_first_seen(first, found, seen)
        aligner = ViewAligner(trainer)
        views = [
            replace(view, camera=aligner.world(view.camera, still.camera(camera), level.step))
            for view, camera in zip(views, found.cameras, strict=True)
        ]
    return views


class ViewAligner:
    """Aligns photos with a trained twin: their cameras move, the twin stays."""

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer

    def judged(self, view: View) -> tuple[float, Camera]:
        """A photo's mean squared residual at the finished twin, its camera moved to where the twin fits it best."""
        level = self.trainer.levels[-1]
        scale, medium = self.trainer.scale, self.trainer.medium
        on_grid = GridView(
            view, scale.camera_to_unit(view.camera), level.step, medium.psf_for(view.name), medium.blur_space
        )
        on_grid.camera = replace(on_grid.camera, fx=level.views[0].camera.fx, fy=level.views[0].camera.fy)
        align_view(self.trainer, level, on_grid)
        return self._error(level, on_grid), self.world(view.camera, on_grid.camera, level.step)

    def _error(self, level: Level, view: GridView) -> float:
        residual = shown(self.trainer, level, view)[0].cpu() - torch.from_numpy(view.planes())
        return mean_square(residual, mask_of(view.valid))

    def world(self, given: Camera, unit: Camera, step: int) -> Camera:
        """A camera of the unit world and a grid as one of the world and the photo."""
        scale = self.trainer.scale
        translation = unit.translation * scale.size - unit.rotation @ scale.origin
        return replace(given, rotation=unit.rotation, translation=translation, fx=unit.fx * step, fy=unit.fy * step)
