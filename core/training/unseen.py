"""Photos that are held out: what is theirs alone is found on the Gaussians as they are, which do not see them."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from ..evaluation.halves import exposed_by_halves
from ..forward.compare import mean_square, psnr_of
from .cameras.adjusting import SETTINGS as ADJUSTING
from .cameras.adjusting import placed_camera
from .cameras.beside import laid_beside
from .cameras.twin_tracks import sighted
from .density.dropout import DROPOUT, getting_worse, learned_by_heart
from .following import blur_by_depth, follow_focus, follow_kernel, follow_path
from .grid import GridView
from .level import Level
from .scene import TrainedScene


def follow_unseen(scene: TrainedScene, level: Level, view: GridView) -> None:
    """Learns a step of a held-out photo's own path and focus; the Gaussians do not see it."""
    if not scene.learned.unseen_visits:
        return
    exposed, photo = scene.exposed(level, view), torch.from_numpy(view.planes()).to(scene.device)
    follow_path(scene, level, view, exposed, photo, scene.background)
    follow_focus(scene, view, exposed, photo)
    follow_kernel(scene, view, exposed, photo)


def _find_unseen(scene: TrainedScene, level: Level, view: GridView) -> None:
    """Finds the focus of a photo that is held out from scratch."""
    if scene.learned.focus is not None:
        table = blur_by_depth(scene, level, view)
        if table is not None:
            scene.learned.focus.search_unseen(view.name, table)


def finish_unseen(scene: TrainedScene) -> None:
    """Finds the paths and foci of all photos that are held out on the Gaussians as they are."""
    visits = scene.learned.unseen_visits
    if not visits or not scene.heldout:
        return
    level = scene.levels[-1]
    for view in scene.on_grid(scene.heldout, level.step):
        _find_unseen(scene, level, view)
        for _ in range(visits):
            follow_unseen(scene, level, view)
        _place_unseen(scene, level, view)


def _place_unseen(scene: TrainedScene, level: Level, view: GridView) -> None:
    """Places the camera of a photo that is held out before the finished twin, if it was found.

    What the photos showed when cameras were adjusted last is not quite the twin that became of it.
    """
    paths = scene.learned.paths
    if paths is not None and scene.cameras_moved and view.name in paths.motion.names:
        for _ in range(ADJUSTING.unseen_rounds):
            paths.place(view.camera, placed_camera(sighted(laid_beside(scene, level, view))))


def measure_kernels(scene: TrainedScene) -> None:
    """Finds how well each photo determines its kernel, on the Gaussians as they are."""
    kernels, level = scene.learned.kernels, scene.levels[-1]
    if kernels is None:
        return
    for view in [*level.views, *scene.on_grid(scene.heldout, level.step)]:
        with torch.no_grad():
            exposed, photo = scene.exposed(level, view), torch.from_numpy(view.planes()).to(scene.device)
            asked = scene.learned.asked(view, exposed, photo, 0.0)  # (at the beginning of a run nothing is learned)
            kernels.measure(view.name, exposed, photo if asked is None else asked.photo, scene.counting(view))


def heldout_psnr(scene: TrainedScene) -> float | None:
    """PSNR (dB) of the degraded render against held-out photos, on the finest grid.

    Where photos have exposures of their own, those of held-out ones are taken from halves that do not judge.
    """
    level = scene.levels[-1]
    if not level.heldout:
        return None
    errors = [0.0] * len(level.heldout)
    for index, view in enumerate(level.heldout):
        if index % scene.ranks.count != scene.ranks.rank:
            continue
        _find_unseen(scene, level, view)
        follow_unseen(scene, level, view)
        errors[index] = _error(scene, level, view)
    if not scene.ranks.alone:
        total = torch.tensor(errors)  # (float32: zeros of the other ranks are added)
        scene.ranks.add([total])
        errors = total.tolist()
    return psnr_of(errors)


def _error(scene: TrainedScene, level: Level, view: GridView) -> float:
    """Mean square of what the twin, as it is, shows through the medium less a photo."""
    shown, photo = scene.exposed(level, view).degraded.cpu().numpy(), view.planes()
    if scene.learned.exposures is not None:
        shown = exposed_by_halves(shown, photo, view.valid, view.present())
    return mean_square(shown - photo, view.valid)


def judge_dropout(scene: TrainedScene, share: float, scores: Sequence[float]) -> bool:
    """Whether Gaussians are left out of steps from here on.

    Not where a blur is inverted, which has a price on invented detail already, nor where held-out photos have
    something of their own to be found first: what is wrong with it counts as a gap.

    Args:
        share: of the run, in [0, 1]; scores: PSNR (dB) of held-out photos so far.
    """
    level = scene.levels[-1]
    if scene.asked["dropout"] or share < DROPOUT.begin or not getting_worse(scores):
        return False
    if scene.learned.unseen_visits or level.ratio is not None or not scene.ranks.alone:
        return False
    count = min(DROPOUT.compared, len(scene.views))
    fitted = [_error(scene, level, level.views[i * len(level.views) // count]) for i in range(count)]
    scene.asked["dropout"] = int(learned_by_heart(scores[-1], psnr_of(fitted)))
    return bool(scene.asked["dropout"])
