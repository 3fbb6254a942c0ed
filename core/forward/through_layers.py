"""What a lens out of focus shows of a twin: rendered in layers by distance, each blurred by its own width.

The blur of one picture by the depth of its surface (`imaging.formation.occluding`) does not see what is thin: where a
twig is out of focus, most of the light of its px comes from the wall behind it, whose depth they are given, and what
the twig hides is in no px. Layers of the twin itself have both.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..camera import Camera
from ..colour import linear_to_srgb
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..imaging.formation.focus import FocusBlur
from ..imaging.formation.layer_blur import blurred_layers, places
from ..imaging.formation.layered import LAYERED
from ..rasterizer import RasterSettings, Rendered, render_layers


@dataclass(frozen=True)
class ThroughLayers:
    """One photo's light.

    Attributes:
        view: the sharp view; reached: [3, h, w] sRGB as it reaches the medium. Both with gradient.
    """

    view: Rendered
    reached: Tensor


def layered_focus(formation: Formation, name: str) -> FocusBlur | None:
    """The focus that a photo is to be rendered in layers for; None where there is none, or none has been found yet.

    Only where nothing else happens to the light before the medium.
    """
    focus = formation.focus
    if focus is None or len(formation.light) != 1:
        return None
    own = focus.of(name)
    return focus if own is not None and own.strength > 0 else None


def through_layers(
    gaussians: Gaussians,
    camera: Camera,
    background: Tensor | None,
    settings: RasterSettings,
    focus: FocusBlur,
    shot: Shot,
) -> ThroughLayers | None:
    """A photo's light, frame by `camera`; None where nothing is out of focus by as much as shows.

    Args:
        camera: of the frame, margin included; shot: of the photo; others as of `render`.
    """
    row = focus.row_of(shot.name)
    assert row is not None
    towards = torch.from_numpy(camera.rotation[2]).to(gaussians.means)
    depth = gaussians.means @ towards + float(camera.translation[2])
    width = focus.widths([value.detach() for value in focus.parameters.values()], depth, row, shot)
    with torch.no_grad():
        if not bool((width[depth > settings.near].abs() >= LAYERED.invisible).any()):
            return None
    place = places(width, focus.shape, (camera.height, camera.width))
    layers = render_layers(gaussians, camera, place, background=background, settings=settings)
    light = blurred_layers(layers.planes, layers.numbers, layers.view.image, focus.shape)
    return ThroughLayers(layers.view, linear_to_srgb(light))
