"""When all cameras are moved in a run, and what goes along: paths, held-out photos and the Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch

from ... import compiled
from ..grid import GridView
from ..level import Level
from ..scene import TrainedScene
from ..unseen import follow_unseen
from .adjusting import SETTINGS as ADJUSTING
from .adjusting import adjusted_cameras, contradicted, due
from .beside import laid_beside
from .twin_tracks import Sighting, carried, sighted

#: What photos said of cameras that were given.
_BELIEVED, _CONTRADICTED = 1, 2


def _adjusts(scene: TrainedScene, share: float) -> bool:
    """Whether cameras are to be adjusted at a share of the run."""
    movable = scene.adjust != "never" and scene.asked["given"] != _BELIEVED
    return movable and scene.asked["adjusted"] < due(share)


def adjust_cameras(scene: TrainedScene, share: float, cancelled: Callable[[], bool] = lambda: False) -> None:
    """Moves all cameras and the surface by what photos show beside the twin, where a share of the run makes it due.

    Only of photos that were shaken: cameras that were found, and given ones that the photos contradict when this
    is due for the first time. Where it is cancelled on the way, it is still due.
    """
    paths = scene.learned.paths
    if paths is None or not _adjusts(scene, share):
        return
    level = scene.levels[0] if share < scene.settings.coarse_share else scene.levels[-1]
    if sum(view.camera.width * view.camera.height for view in level.views) > ADJUSTING.most_px:
        return
    fitted = [view for view in level.views if view.name in paths.motion.names]
    seen = _beside(scene, level, fitted, cancelled)
    if seen is None or not _doubted(scene, seen):
        return
    unseen = [view for view in scene.on_grid(scene.heldout, level.step) if view.name in paths.motion.names]
    for view in unseen:
        for _ in range(ADJUSTING.unseen_visits):
            follow_unseen(scene, level, view)
    others = _beside(scene, level, unseen, cancelled)
    if others is None:
        return
    scene.asked["adjusted"] = due(share)
    moved = adjusted_cameras(seen, others, [view.camera for view in fitted], _drawn_tracks(scene))
    if moved is None:
        return
    for view, camera in zip([*fitted, *unseen], moved.cameras, strict=True):
        paths.place(view.camera, camera)
    means = scene.optimizer.gaussians.means
    with torch.no_grad():
        places = carried(means.cpu().double().numpy(), moved.before, moved.after)
        means.copy_(torch.from_numpy(places).to(means))


def _doubted(scene: TrainedScene, seen: Sequence[Sighting]) -> bool:
    """Whether the cameras may be wrong: found ones always may; of given ones the photos are asked, once."""
    if scene.adjust == "contradicted" and not scene.asked["given"]:
        scene.asked["given"] = _CONTRADICTED if contradicted(seen, _drawn_tracks(scene)) else _BELIEVED
    return scene.asked["given"] != _BELIEVED


def _drawn_tracks(scene: TrainedScene) -> np.random.Generator:
    """Which points of the twin are followed through the photos in this step."""
    return np.random.default_rng([scene.settings.seed, 5, scene.step])


def _beside(
    scene: TrainedScene, level: Level, views: Sequence[GridView], cancelled: Callable[[], bool]
) -> list[Sighting] | None:
    """Where photos lie beside the twin; None if it is cancelled."""
    with ThreadPoolExecutor(compiled.threads()) as pool:  # (shifts take longer than renders, and one core each)
        pending = []
        for view in views:
            if cancelled():
                return None
            pending.append(pool.submit(sighted, laid_beside(scene, level, view)))
        return [one.result() for one in pending]
