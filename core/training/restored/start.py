"""When a run restores its photos, and how it begins anew with them."""

from __future__ import annotations

from ..density.control import DensityControl
from ..optimizer import Adam
from ..scene import TrainedScene
from .course import COURSE
from .photos import RestoredPhotos


def restores(scene: TrainedScene) -> bool:
    """Whether the photos of a run are restored: their own motion is all that blurs them, and is known by then."""
    motion, views = scene.formation.motion, scene.levels[-1].views
    if motion is None or motion.readout != 0.0 or not any(view.name in motion.names for view in views):
        return False
    if scene.formation.light or any(view.psf is not None for view in views) or scene.transparent:
        return False
    if scene.settings.until is not None:  # (such a run does not know how long it will be)
        return False
    known = COURSE.begin * scene.settings.steps >= COURSE.fewest_visits * len(views)
    return known and sum(view.camera.width * view.camera.height for view in views) <= COURSE.most_px


def begin_anew(scene: TrainedScene) -> RestoredPhotos:
    """Photos restored around the twin as it is, and new Gaussians in its place, which are fitted to them."""
    level, restored = scene.levels[-1], RestoredPhotos(scene.optimizer.gaussians)
    first = scene.new_gaussians(level, lambda i: restored.of(scene, level, level.views[i]).planes.cpu().numpy())
    refused, counts = scene.optimizer.refused, scene.density.counts
    scene.optimizer = Adam(first.to(scene.device))
    scene.optimizer.refused = refused
    scene.density = DensityControl(len(first), scene.device)
    scene.density.counts = counts
    scene.asked["photos"], scene.restored_around = 0, restored.twin
    return restored
