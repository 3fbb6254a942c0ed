"""Where each photo sees what all photos agree on.

A short training makes a twin that is the photos' consensus. Each photo is aligned with the twin's own view,
rendered and blurred as the medium does; points on the twin's surface then are seen by many photos, each at
its own shifted position. No features have to be found, and the blur is no obstacle, as both sides have it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..evaluation.shifts import Shifts, shifts_between
from ..numbers import number
from ..training.cameras.bundle import Observations, aligned_camera
from ..training.cameras.twin_tracks import on_surface, seen_points
from ..training.grid import GridView
from ..training.level import Level
from ..training.trainer import Trainer

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ConsensusSettings:
    """Of the points that photos and twin are compared at."""

    cell: int = number(24, "px of the grid", "one point at most in a square of this side")
    cells: int = number(10, "count", "squares along the shorter side at least, on small grids")
    points: int = number(1500, "count", "points in all: more make the adjustment slower, not more exact")
    edge: int = number(8, "px of the grid", "points keep this from the frame's border, where shifts have half a window")
    same_depth: float = number(
        0.03, "share of the depth", "a point is seen where the twin's surface is no farther or nearer than this"
    )
    photos_per_point: int = number(3, "count", "photos that must see a point")
    points_per_camera: int = number(12, "count", "points that a camera must see to be aligned")
    largest_error: float = number(3.0, "px of the grid", "shifts that are less certain than this do not count")
    largest_shift: float = number(12.0, "px of the grid", "shifts that are larger do not count")
    smallest_error: float = number(0.05, "px of the grid", "no window is aligned better than this")
    rounds: int = number(
        3, "count", "a camera is aligned this often, each time with the twin seen from where it then is"
    )


SETTINGS = ConsensusSettings()


def observations(trainer: Trainer, seed: int) -> tuple[Floats, Observations]:
    """[M, 3] points in the trainer's unit world, and where the finest grid's photos see them."""
    level = trainer.levels[-1]
    found = [_shifts(trainer, level, view) for view in level.views]
    points = np.concatenate([_surface(view, *one) for view, one in zip(level.views, found, strict=True)])
    points = points[np.random.default_rng([seed, 4]).permutation(len(points))[: SETTINGS.points]]
    parts = [_seen(view, points, *one) for view, one in zip(level.views, found, strict=True)]
    camera = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    point, position, error = (np.concatenate([part[k] for part in parts]) for k in range(3))
    kept = np.bincount(point, minlength=len(points))[point] >= SETTINGS.photos_per_point
    used, index = np.unique(point[kept], return_inverse=True)
    return points[used], Observations(camera[kept], index, position[kept], error[kept])


def disagreement(trainer: Trainer) -> Floats:
    """[V] px of the photo by which each photo is shifted against the twin's view of it, a median over its surface."""
    level = trainer.levels[-1]
    found = []
    for view in level.views:
        shifts, depth = _shifts(trainer, level, view)
        points = _surface(view, shifts, depth)
        index, position, _ = _seen(view, points, shifts, depth)
        camera = view.camera
        local = points[index] @ camera.rotation.T + camera.translation
        off = np.linalg.norm(position - local[:, :2] / local[:, 2:] * [camera.fx, camera.fy], axis=1)
        found.append(float(np.median(off)) * level.step if len(off) >= SETTINGS.points_per_camera else np.nan)
    return np.array(found)


def align_view(trainer: Trainer, level: Level, view: GridView) -> None:
    """Moves a view's camera to where the twin, as it is, shows what the photo does."""
    for _ in range(SETTINGS.rounds):
        shifts, depth = _shifts(trainer, level, view)
        points = _surface(view, shifts, depth)
        index, position, error = _seen(view, points, shifts, depth)
        if len(index) < SETTINGS.points_per_camera:
            return
        view.camera = aligned_camera(view.camera, points[index], position, error)


def shown(trainer: Trainer, level: Level, view: GridView) -> tuple[torch.Tensor, Floats]:
    """[3, H, W] what the photo would be, by the twin and the medium, and [H, W] the twin's depth."""
    model = trainer.model(level)
    model = replace(model, settings=replace(model.settings, depth=True))
    with torch.no_grad():
        exposed = model.expose(trainer.optimizer.gaussians, view, trainer.background)
        picture, surface = exposed.degraded, exposed.mean_depth
    assert surface is not None
    m, camera = level.margin, view.camera
    depth = surface[m : m + camera.height, m : m + camera.width]
    return picture, depth.cpu().numpy().astype(np.float64)


def _shifts(trainer: Trainer, level: Level, view: GridView) -> tuple[Shifts, Floats]:
    """Shifts of the photo against the twin's blurred view, and [H, W] the twin's depth."""
    picture, depth = shown(trainer, level, view)
    return shifts_between(picture.cpu().numpy(), view.planes(), view.valid), depth


def _surface(view: GridView, found: Shifts, depth: Floats) -> Floats:
    """[N, 3] points on the twin's surface, where each cell of the photo has most detail."""
    camera = view.camera
    edge = SETTINGS.edge
    cell = max(4, min(SETTINGS.cell, min(depth.shape) // SETTINGS.cells))
    height, width = ((side - 2 * edge) // cell * cell for side in depth.shape)
    inner = slice(edge, edge + height), slice(edge, edge + width)
    cells = found.detail[inner].reshape(height // cell, cell, width // cell, cell).swapaxes(1, 2)
    best = cells.reshape(*cells.shape[:2], -1).argmax(axis=2)
    row = (np.arange(cells.shape[0])[:, None] * cell + best // cell + edge).ravel()
    column = (np.arange(cells.shape[1])[None, :] * cell + best % cell + edge).ravel()
    return on_surface(camera, row, column, depth)


def _seen(view: GridView, points: Floats, found: Shifts, depth: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Which points the photo sees, [K, 2] where (px from the optical axis), and [K] how certain that is."""
    return seen_points(points, view.camera, (found.shift, found.error, depth), SETTINGS)
