"""Steps of what is learned of each photo with the Gaussians: its path, its focus, its kernel."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache

import torch

from .. import compiled
from ..forward import Exposed, SubFrame, sharp_view, surface_seen
from ..imaging.formation.effect import Shot
from .grid import GridView
from .level import Level
from .optics.focus import BlurByDepth, Seen
from .scene import TrainedScene


def ask_path(
    scene: TrainedScene, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
) -> Callable[[], None]:
    """What a photo says of its path, asked beside the backward pass; what is returned takes the step.

    A photo whose path is compared with others, or whose light passes more than the path, is asked when that is
    called: effects keep what they computed.
    """
    paths, alone = scene.learned.paths, lambda: follow_path(scene, level, view, exposed, photo, behind)
    if paths is None:
        return alone
    plain = view.psf is None and exposed.together is None
    apart = plain and scene.device.type == "cpu" and compiled.threads() > 1
    if not apart or paths.looks_again(view.name):
        return alone
    asking = _beside().submit(_asked_path, scene, level, view, exposed, photo, behind)
    return lambda: asking.result()()


def _asked_path(
    scene: TrainedScene, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
) -> Callable[[], None]:
    paths = scene.learned.paths
    assert paths is not None
    if paths.wants_depth(view.name, view.camera):
        _still(scene, level, view, behind)
    return paths.ask(view.name, view.camera, exposed, photo, scene.counting(view))


def follow_path(
    scene: TrainedScene, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
) -> None:
    """Learns a step of the path that the camera took in a photo; `behind`: [3] sRGB."""
    paths = scene.learned.paths
    if paths is None:
        return
    again = paths.looks_again(view.name)
    if again or paths.wants_depth(view.name, view.camera):
        still = _still(scene, level, view, behind)
    counts = scene.counting(view)
    if again:
        expose = lambda: scene.exposed(level, view, behind)  # noqa: E731
        paths.look_again(view.name, view.camera, photo, still, expose, counts)
    paths.learn(view.name, view.camera, exposed, photo, counts)


def _still(scene: TrainedScene, level: Level, view: GridView, behind: torch.Tensor) -> torch.Tensor:
    """[3, H, W] sRGB as the twin shows a photo without motion; its path goes by the depth there from now on."""
    assert scene.learned.paths is not None
    settings = replace(scene.raster_settings(level), depth=True)
    with torch.no_grad():
        still = sharp_view(scene.optimizer.gaussians, view.camera, settings, behind)
        surface = surface_seen(scene.optimizer.gaussians, view.camera, settings, still)
    scene.learned.paths.see_depth(view.name, surface)
    return still.image


def follow_focus(scene: TrainedScene, view: GridView, exposed: Exposed, photo: torch.Tensor) -> None:
    """Learns a step of a photo's focus."""
    if scene.learned.focus is not None:
        scene.learned.focus.learn(view.name, exposed, photo, scene.counting(view))


def follow_kernel(scene: TrainedScene, view: GridView, exposed: Exposed, photo: torch.Tensor) -> None:
    """Learns a step of a photo's kernel."""
    if scene.learned.kernels is not None:
        scene.learned.kernels.learn(view.name, exposed, photo, scene.counting(view))


def find_focus(scene: TrainedScene, level: Level, share: float) -> None:
    """Compares all photos with the twin where a share of the run makes it due; see `training.optics.focus`."""
    focus = scene.learned.focus
    if focus is None or not focus.due(share):
        return
    tables = {view.name: blur_by_depth(scene, level, view) for view in level.views}
    focus.search({name: table for name, table in tables.items() if table is not None}, share)


def blur_by_depth(scene: TrainedScene, level: Level, view: GridView) -> BlurByDepth | None:
    """How a photo differs from the twin's view, blurred evenly."""
    focus, medium = scene.learned.focus, scene.objective(level, view).medium
    assert focus is not None
    counts = scene.counting(view)
    camera, photo = view.camera, torch.from_numpy(view.planes()).to(scene.device)
    with torch.no_grad():
        model, gaussians = scene.model(level), scene.optimizer.gaussians
        sharp = model.sharp(gaussians, camera, scene.background)
        depth = model.surface(gaussians, SubFrame(camera.with_margin(level.margin)), sharp)
        assert depth is not None
        shot = Shot(view.name, camera.height, camera.width, level.margin, (camera.cx, camera.cy))
        return BlurByDepth.of(Seen(sharp, depth, photo, counts, medium, shot), focus.effect, focus.settings)


@lru_cache(maxsize=1)
def _beside() -> ThreadPoolExecutor:
    """The thread beside that of the training: one for all trainings, as torch keeps threads of its own for each."""
    return ThreadPoolExecutor(1, "dgs-beside")
