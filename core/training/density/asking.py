"""All photos are asked, now and then, what they need of the twin: the rest goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from ...camera import Camera
from ...rasterizer import RasterSettings
from ..grid import GridView
from ..scene import TrainedScene
from .contribution import SeenByPhotos, due, needed, photos_asked, seen_by
from .veils import veils


def ask_photos(scene: TrainedScene, share: float) -> None:
    """Asks all photos what they see of each Gaussian, where a share in [0, 1] of the run makes it due, and goes on
    without those that none of them needs, and without veils (`training.density.veils`)."""
    if scene.asked["photos"] >= due(share, scene.settings.steps, len(scene.views)):
        return
    level = scene.levels[0]
    # What lies beyond a photo's border is blurred into it, and counts.
    count = photos_asked(scene.settings.steps, len(level.views))
    chosen = [level.views[i * len(level.views) // count] for i in range(count)]
    photos = [(view.camera.with_margin(level.margin), _counting(scene, view, level.margin)) for view in chosen]
    settings = replace(scene.raster_settings(level), depth=False)
    wanted = needed(_seen(scene, photos, settings)) & ~_veils(scene, [view.camera for view in chosen])
    rows = torch.nonzero(wanted)[:, 0]
    before = len(scene.optimizer.gaussians)
    if 0 < len(rows) < before:
        scene.density.keep(scene.optimizer, rows)
        scene.asked["unneeded"] += before - len(rows)
    scene.asked["photos"] += 1


def _seen(
    scene: TrainedScene, photos: list[tuple[Camera, torch.Tensor | None]], settings: RasterSettings
) -> SeenByPhotos:
    """What the photos see of each Gaussian; every rank looks at some of them."""
    own, gaussians = photos[scene.ranks.rank :: scene.ranks.count], scene.optimizer.gaussians
    if scene.ranks.alone:
        return seen_by(gaussians, own, settings)
    found = seen_by(gaussians, own, settings) if own else SeenByPhotos.nothing(len(gaussians), scene.device)
    scene.ranks.add(list(found.sums()))
    return found


def _veils(scene: TrainedScene, cameras: Sequence[Camera]) -> torch.Tensor:
    """[N] bool: Gaussians that are veils before photos' cameras, on all ranks the same."""
    points = scene.scale.points_to_unit(scene.points.positions)
    found = torch.from_numpy(veils(scene.optimizer.gaussians.means.detach().cpu().numpy(), cameras, points))
    if not scene.ranks.alone:  # (centres differ in last digits where processors differ)
        agreeing = found.float()
        scene.ranks.add([agreeing])
        found = agreeing > scene.ranks.count - 0.5
    return found.to(scene.device)


def _counting(scene: TrainedScene, view: GridView, margin: int) -> torch.Tensor | None:
    """[H + 2m, W + 2m] float32: 1 for the px that count in a photo; None for all of them."""
    if view.valid is None:
        return None
    counting = np.pad(view.valid, margin, constant_values=True)
    return torch.from_numpy(counting.astype(np.float32)).to(scene.device)
