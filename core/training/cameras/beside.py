"""Photos beside what the twin in training shows of them."""

from __future__ import annotations

from dataclasses import replace

import torch

from ...forward import sharp_view, surface_seen
from ..grid import GridView
from ..level import Level
from ..scene import TrainedScene
from .adjusting import SETTINGS as ADJUSTING
from .twin_tracks import LaidBeside


def laid_beside(scene: TrainedScene, level: Level, view: GridView) -> LaidBeside:
    """A photo, and what the twin shows of it."""
    paths = scene.learned.paths
    assert paths is not None
    camera = paths.stands(view.camera)
    shown = scene.exposed(level, view).degraded.cpu().numpy()
    settings = replace(scene.raster_settings(level), depth=True)
    with torch.no_grad():
        still = sharp_view(scene.optimizer.gaussians, camera, settings, scene.background)
        surface = surface_seen(scene.optimizer.gaussians, camera, settings, still)
    depth = torch.where(still.alpha > ADJUSTING.opaque, surface, 0.0).cpu().numpy()
    return LaidBeside(camera, shown, view.planes(), depth, view.valid)
