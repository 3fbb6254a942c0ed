"""Cameras and Gaussians found together: the photos' own loss, through the blur, moves the cameras too.

A short training runs twice from the same seed: with the cameras as they are, and with steps of all cameras in
between. Photos that neither trains on judge: both twins may lay those photos' cameras where they like
(structure from motion placed them no better than the rest), and the refined cameras are kept only if the
judges' loss falls by more than its standard error. Sharp sets with good cameras keep them that way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..errors import Cancelled
from ..imaging.medium import Medium
from ..progress import Progress
from ..rasterizer import render
from ..training.grid import GridView
from ..training.settings import TrainingSettings
from ..training.trainer import Level, Trainer
from ..views import SparsePoints, View
from .pose_steps import Equations, equations, solved, twisted, without_gauge, zoomed

#: Every so many photos judges where none is held out.
JUDGES_EVERY = 8
#: Iterations and splats of the short trainings; cameras need the shape, not the last detail.
STEPS, MOST_GAUSSIANS = 500, 15_000
#: Steps of the cameras: how many, and the share of the run before the first and after the last.
ROUNDS, BEGIN, END = 8, 0.15, 0.9
#: Grid px by which photos are smoothed in the first step of the cameras; it halves from step to step.
SMOOTH = 4.0
#: Steps of a judge's camera at a finished twin, from smoothed photos to sharp ones.
JUDGE_SMOOTH = (4.0, 2.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Refined:
    """What came out.

    Attributes:
        kept: whether the refined cameras are better by more than the judges' standard error.
        cameras: by name, all views', world units: the refined ones if kept, else those that came in.
        focal_change: refined over given focal length, less 1.
        moved_px: median of how far the cameras moved, px at the scene's distance, after taking out the gauge.
        loss_before, loss_after: mean of the judges' squared residual, in 8-bit steps squared.
        error: standard error of the judges' mean difference, in the same unit.
        judges: names.
    """

    kept: bool
    cameras: dict[str, Camera]
    focal_change: float
    moved_px: float
    loss_before: float
    loss_after: float
    error: float
    judges: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """For report.json."""
        content = asdict(replace(self, cameras={}))
        content.pop("cameras")
        return content


def refine_cameras(views: Sequence[View], judges: Sequence[View], points: SparsePoints, medium: Medium,
                   settings: TrainingSettings, progress: Progress, focal: bool = True) -> Refined:  # fmt: skip
    """Refines the cameras of `views` and `judges`.

    Args:
        views: photos to fit; judges: photos to judge by, if empty every 8th view.
        settings: seed, threads and loss are taken over, effort is not.
        focal: whether the shared focal length may change.

    Raises:
        Cancelled: the user asked to stop.
    """
    if not judges:
        judges = views[::JUDGES_EVERY]
        views = [view for index, view in enumerate(views) if index % JUDGES_EVERY]
    short = replace(settings, steps=STEPS, max_gaussians=min(settings.max_gaussians, MOST_GAUSSIANS), time_limit=None)
    losses, cameras, placed = [], [], []
    for moving in (False, True):
        progress.stage("cameras by the loss" if moving else "cameras as found", short.steps)
        trainer = Trainer(views, [], points, medium, short)
        mover = Mover(trainer, focal)
        rounds = [int(s) for s in np.linspace(BEGIN * short.steps, END * short.steps, ROUNDS)] if moving else []
        for step in range(short.steps):
            if step in rounds:
                mover.step(SMOOTH / 2 ** rounds.index(step))
            trainer.advance(step / short.steps)
            if step % 10 == 0:
                progress.advance(step)
                if progress.cancelled():
                    raise Cancelled("Stopped while refining the cameras")
        judged = [mover.judged(view) for view in judges]
        losses.append(np.array([loss for loss, _ in judged]) * 255.0**2)
        placed.append({view.name: camera for view, (_, camera) in zip(judges, judged, strict=True)})
        cameras.append(mover.cameras())
    gain = losses[0] - losses[1]
    error = float(gain.std(ddof=1) / len(gain) ** 0.5) if len(gain) > 1 else float("inf")
    kept = float(gain.mean()) > error
    given = {view.name: view.camera for view in [*views, *judges]}
    found = {**cameras[1], **placed[1]} if kept else given
    px = [
        np.linalg.norm(cameras[1][v.name].centre - v.camera.centre) / trainer.scale.size * v.camera.fx for v in views
    ]
    ratio = cameras[1][views[0].name].fx / views[0].camera.fx
    return Refined(
        kept, found, float(ratio - 1.0), float(np.median(px)), float(losses[0].mean()), float(losses[1].mean()),
        error, tuple(view.name for view in judges),
    )  # fmt: skip


class Mover:
    """Moves the cameras of a trainer between its steps."""

    def __init__(self, trainer: Trainer, focal: bool) -> None:
        self.trainer, self.focal = trainer, focal
        self.began = {view.name: view.camera for view in trainer.levels[-1].views}

    def looker(self, level: Level, view: GridView) -> Callable[[Camera], Tensor]:
        """Camera -> [3, H, W], what the photo would be."""
        trainer = self.trainer
        objective = trainer.objective(level, view)
        settings = trainer.raster_settings(level)

        def look(camera: Camera) -> Tensor:
            with torch.no_grad():
                rendered = render(
                    trainer.optimizer.gaussians, camera.with_margin(level.margin), background=trainer.background,
                    settings=settings,
                )  # fmt: skip
                reached = trainer.formation.reached(rendered.image, trainer.shot(view, level, rendered))
                return objective.degraded(reached)

        return look

    def pull(self, level: Level, view: GridView, focal: bool, smooth: float) -> Equations:
        """The photo's equations at the twin as it is."""
        valid = None if view.valid is None else torch.from_numpy(view.valid)
        return equations(view.camera, torch.from_numpy(view.planes()), valid, self.looker(level, view), focal,
                         smooth)  # fmt: skip

    def step(self, smooth: float = 0.0) -> None:
        """One step of every camera, on the finest grid; the coarser grids follow."""
        level = self.trainer.levels[-1]
        focal = self.focal and smooth < 1.0
        pulls = [self.pull(level, view, focal, smooth) for view in level.views]
        drift = [self._drift(view, pull) for view, pull in zip(level.views, pulls, strict=True)]
        twists, share = solved(pulls, focal, drift)
        before = [self.began[view.name] for view in level.views]
        after = [zoomed(twisted(v.camera, twist), share) for v, twist in zip(level.views, twists, strict=True)]
        self._place(without_gauge(before, after))

    def _drift(self, view: GridView, pull: Equations) -> np.ndarray:
        from scipy.spatial.transform import Rotation

        began = self.began[view.name]
        turn = view.camera.rotation @ began.rotation.T
        shift = view.camera.translation - turn @ began.translation
        return np.concatenate([shift, Rotation.from_matrix(turn).as_rotvec()]) / pull.units[:6]

    def _place(self, cameras: Sequence[Camera]) -> None:
        fine = self.trainer.levels[-1]
        for level in self.trainer.levels:
            for view, camera in zip(level.views, cameras, strict=True):
                s = level.step / fine.step
                view.camera = replace(
                    view.camera, rotation=camera.rotation, translation=camera.translation,
                    fx=camera.fx / s, fy=camera.fy / s,
                )  # fmt: skip

    def cameras(self) -> dict[str, Camera]:
        """World cameras by name, at the photos' size."""
        level = self.trainer.levels[-1]
        return {
            view.name: self._world(given.camera, view.camera, level.step)
            for given, view in zip(self.trainer.views, level.views, strict=True)
        }

    def judged(self, view: View) -> tuple[float, Camera]:
        """A photo's mean squared residual at the finished twin, its camera laid where the twin fits it best."""
        level = self.trainer.levels[-1]
        scale, medium = self.trainer.scale, self.trainer.medium
        on_grid = GridView(
            view, scale.camera_to_unit(view.camera), level.step, medium.psf_for(view.name), medium.blur_space
        )  # fmt: skip
        on_grid.camera = replace(on_grid.camera, fx=level.views[0].camera.fx, fy=level.views[0].camera.fy)
        best, squares = on_grid.camera, np.inf
        for smooth in (*JUDGE_SMOOTH, None):
            error = self._error(level, on_grid)
            if error < squares:
                best, squares = on_grid.camera, error
            if smooth is None:
                break
            pull = self.pull(level, on_grid, False, smooth)
            (twist,), _ = solved([pull], False, [np.zeros(6)])
            on_grid.camera = twisted(on_grid.camera, twist)
        return squares, self._world(view.camera, best, level.step)

    def _error(self, level: Level, view: GridView) -> float:
        residual = (self.looker(level, view)(view.camera) - torch.from_numpy(view.planes())).square()
        return float(residual.mean() if view.valid is None else residual[:, torch.from_numpy(view.valid)].mean())

    def _world(self, given: Camera, unit: Camera, step: int) -> Camera:
        scale = self.trainer.scale
        translation = unit.translation * scale.size - unit.rotation @ scale.origin
        return replace(
            given, rotation=unit.rotation, translation=translation, fx=unit.fx * step, fy=unit.fy * step
        )  # fmt: skip
