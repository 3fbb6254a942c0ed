"""Where each photo sees what all photos agree on.

A short training makes a twin that is the photos' consensus. Each photo is laid over the twin's own view,
rendered and blurred as the medium does; places on the twin's surface then are points that many photos see, each at
its own shifted place. No features have to be found, and the blur is no obstacle, as both sides have it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ..rasterizer import render
from ..training.grid import GridView
from ..training.trainer import Level, Trainer
from .adjust import Sightings, laid
from .shifts import Shifts, shifts_between

Floats = NDArray[np.float64]

#: One point at most in a cell of so many grid px, or with so many cells along the shorter side; points in all, and px
#: that they keep from the frame's edge.
CELL, CELLS, MOST, EDGE = 24, 10, 1500, 8
#: A point is seen where the twin's surface is no farther or nearer than this share; by so many photos at least.
SAME_DEPTH, FEWEST = 0.03, 3
#: A camera is laid by so many points at least.
FEWEST_TO_LAY = 12
#: Sightings that are less certain than this, or farther off, tell nothing, px.
WORST_ERROR, LONGEST = 3.0, 12.0
#: No window is laid better than this, px.
BEST_ERROR = 0.05


def sightings(trainer: Trainer, seed: int) -> tuple[Floats, Sightings]:
    """[M, 3] points in the trainer's unit world, and where the finest grid's photos see them."""
    level = trainer.levels[-1]
    looks = [_look(trainer, level, view) for view in level.views]
    points = np.concatenate([_surface(view, *look) for view, look in zip(level.views, looks, strict=True)])
    points = points[np.random.default_rng([seed, 4]).permutation(len(points))[:MOST]]
    parts = [_seen(view, points, *look) for view, look in zip(level.views, looks, strict=True)]
    camera = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    point, place, error = (np.concatenate([part[k] for part in parts]) for k in range(3))
    kept = np.bincount(point, minlength=len(points))[point] >= FEWEST
    known, index = np.unique(point[kept], return_inverse=True)
    return points[known], Sightings(camera[kept], index, place[kept], error[kept])


def disagreement(trainer: Trainer) -> Floats:
    """[V] px of the photo by which each photo is shifted against the twin's view of it, a median over its surface."""
    level = trainer.levels[-1]
    found = []
    for view in level.views:
        look = _look(trainer, level, view)
        points = _surface(view, *look)
        index, place, _ = _seen(view, points, *look)
        camera = view.camera
        local = points[index] @ camera.rotation.T + camera.translation
        off = np.linalg.norm(place - local[:, :2] / local[:, 2:] * [camera.fx, camera.fy], axis=1)
        found.append(float(np.median(off)) * level.step if len(off) >= FEWEST_TO_LAY else np.nan)
    return np.array(found)


def laid_over(trainer: Trainer, level: Level, view: GridView, rounds: int = 3) -> None:
    """Moves a view's camera to where the twin, as it is, shows what the photo does."""
    for _ in range(rounds):
        look = _look(trainer, level, view)
        points = _surface(view, *look)
        index, place, error = _seen(view, points, *look)
        if len(index) < FEWEST_TO_LAY:
            return
        view.camera = laid(view.camera, points[index], place, error)


def shown(trainer: Trainer, level: Level, view: GridView) -> tuple[torch.Tensor, Floats]:
    """[3, H, W] what the photo would be, by the twin and the medium, and [H, W] the twin's depth."""
    settings = replace(trainer.raster_settings(level), depth=True)
    with torch.no_grad():
        rendered = render(
            trainer.optimizer.gaussians,
            view.camera.with_margin(level.margin),
            background=trainer.background,
            settings=settings,
        )
        reached = trainer.formation.reached(rendered.image, trainer.shot(view, level, rendered))
        picture = trainer.objective(level, view).degraded(reached)
    assert rendered.mean_depth is not None
    m, camera = level.margin, view.camera
    depth = rendered.mean_depth[m : m + camera.height, m : m + camera.width]
    return picture, depth.cpu().numpy().astype(np.float64)


def _look(trainer: Trainer, level: Level, view: GridView) -> tuple[Shifts, Floats]:
    """Shifts of the photo against the twin's blurred view, and [H, W] the twin's depth."""
    picture, depth = shown(trainer, level, view)
    return shifts_between(picture.cpu().numpy(), view.planes(), view.valid), depth


def _surface(view: GridView, found: Shifts, depth: Floats) -> Floats:
    """[N, 3] points on the twin's surface, where each cell of the photo has most detail."""
    camera = view.camera
    cell = max(4, min(CELL, min(depth.shape) // CELLS))
    height, width = ((side - 2 * EDGE) // cell * cell for side in depth.shape)
    inner = slice(EDGE, EDGE + height), slice(EDGE, EDGE + width)
    cells = found.detail[inner].reshape(height // cell, cell, width // cell, cell).swapaxes(1, 2)
    best = cells.reshape(*cells.shape[:2], -1).argmax(axis=2)
    row = (np.arange(cells.shape[0])[:, None] * cell + best // cell + EDGE).ravel()
    column = (np.arange(cells.shape[1])[None, :] * cell + best % cell + EDGE).ravel()
    d = depth[row, column]
    local = np.stack([(column + 0.5 - camera.cx) / camera.fx * d, (row + 0.5 - camera.cy) / camera.fy * d, d], axis=1)
    points: Floats = (local[np.isfinite(d) & (d > 0)] - camera.translation) @ camera.rotation
    return points


def _seen(view: GridView, points: Floats, found: Shifts, depth: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Which points the photo sees, [K, 2] where (px from the optical axis), and [K] how certain that is."""
    camera = view.camera
    height, width = depth.shape
    local = points @ camera.rotation.T + camera.translation
    z = local[:, 2]
    safe = np.where(z > 0, z, 1.0)[:, None]
    place = local[:, :2] / safe * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    inside = (z > 0) & (place > EDGE).all(axis=1) & (place < [width - EDGE, height - EDGE]).all(axis=1)
    index = np.flatnonzero(inside)
    at = [place[index, 1] - 0.5, place[index, 0] - 0.5]
    here, error, x, y = (map_coordinates(p, at, order=1, mode="nearest") for p in (depth, found.error, *found.shift))
    shift = np.stack([x, y], axis=1)
    good = (np.abs(here / z[index] - 1.0) < SAME_DEPTH) & (error < WORST_ERROR)
    good &= np.linalg.norm(shift, axis=1) < LONGEST
    where = place[index] + shift - [camera.cx, camera.cy]
    return index[good], where[good], np.maximum(error[good], BEST_ERROR)
