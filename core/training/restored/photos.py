"""Photos that were shaken, as the twin and what is left of them say they would be without motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...camera import Camera
from ...colour import linear_to_srgb, srgb_to_linear
from ...devices import in_memory
from ...forward import sharp_view, surface_seen
from ...gaussians import Gaussians
from ...imaging.formation.motion import CameraMotion
from ...imaging.formation.path_poses import polynomials
from ..grid import GridView
from ..level import Level
from ..paths.coordinates import flow_at
from ..scene import TrainedScene
from .inverse import INVERSE, inverted


@dataclass(frozen=True)
class RestoredPhoto:
    """A photo without motion.

    Attributes:
        planes: [3, H, W] sRGB on the grid; weight: [H, W] or the like by which px count less; None where all count.
    """

    planes: Tensor
    weight: Tensor | None


class RestoredPhotos:
    """Photos restored around a twin as it was; each is made when it is asked for first, and kept.

    Args:
        twin: in the scene's unit.
    """

    def __init__(self, twin: Gaussians) -> None:
        self.twin = twin.detached()
        self._kept: dict[str, RestoredPhoto] = {}

    def of(self, scene: TrainedScene, level: Level, view: GridView) -> RestoredPhoto:
        """One photo, with its exposure undone, on the scene's device; `level`: the grid of all of them."""
        kept = self._kept.get(view.name)
        if kept is None:
            with torch.no_grad():
                made = self._made(scene, level, view)
            kept = RestoredPhoto(made.planes.half(), made.weight)
            self._kept[view.name] = kept
        return RestoredPhoto(kept.planes.float().to(scene.device), kept.weight)

    def _made(self, scene: TrainedScene, level: Level, view: GridView) -> RestoredPhoto:
        photo = torch.from_numpy(view.planes()).to(scene.device)
        exposed = scene.model(level).expose(self.twin, view, scene.background)
        asked = scene.learned.asked(view, exposed, photo, 0.0)  # (at the beginning of a run nothing is learned)
        wanted, weight = (photo, None) if asked is None else (asked.photo, asked.weight)
        motion = scene.formation.motion
        twists = None if motion is None else motion.twists_of(view.name)
        if motion is None or twists is None:  # (it stood still)
            return RestoredPhoto(in_memory(wanted), weight)
        settings = replace(scene.raster_settings(level), depth=True)
        still = sharp_view(self.twin, view.camera, settings, scene.background)
        surface = surface_seen(self.twin, view.camera, settings, still)
        filed, shown = (in_memory(planes) for planes in (wanted, exposed.degraded))
        residual = _light(filed, motion) - _light(shown, motion)
        if view.valid is not None:
            residual = residual * torch.from_numpy(view.valid)
        ways = WaysOf(twists, view.camera, in_memory(surface))
        light = srgb_to_linear(in_memory(still.image)) + inverted(residual, ways.of_part)
        return RestoredPhoto(linear_to_srgb(light.clamp(0.0, 1.0)), weight)


def _light(filed: Tensor, motion: CameraMotion) -> Tensor:
    """Linear light of what the camera filed."""
    return srgb_to_linear(motion.curve.undone(filed) if motion.curve else filed)


@dataclass(frozen=True)
class WaysOf:
    """Where the camera's path leads what is seen in a photo.

    Attributes:
        twists: [M + 1, 6] of the path; camera: of the photo; depth: [H, W] of what is seen, the scene's unit.
    """

    twists: Tensor
    camera: Camera
    depth: Tensor

    def of_part(self, weights: Tensor) -> Tensor:
        """[K, 2] px along x and y, of what is in the middle of a part of the photo with weights [H, W]."""
        camera, (rows, columns) = self.camera, weights.nonzero(as_tuple=True)
        counts = weights[rows, columns]
        y, x = (float((at * counts).sum() / counts.sum()) + 0.5 for at in (rows, columns))
        depths = self.depth[rows, columns]
        seen = depths[depths > 0]
        near = 1.0 / float(seen.median()) if len(seen) else 1.0
        at_x, at_y = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
        moved = torch.stack(flow_at(torch.tensor(at_x), torch.tensor(at_y), torch.tensor(near))) * camera.fx
        times = torch.linspace(-0.5, 0.5, INVERSE.places)
        return polynomials(times, len(self.twists) - 1) @ self.twists @ moved.T
