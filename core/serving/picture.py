"""A camera's view of twins, as rows of pixels in memory."""

from __future__ import annotations

import time

import numpy as np
import torch

from ..compiled import run
from ..forward import sharp_view
from ..forward.collecting import decoding_table
from ..rasterizer import RasterSettings, Rendered
from .messages import Drawn, View
from .packing_kernels import NOWHERE, pack
from .shared_area import SharedArea
from .stage import Stage, Staged

#: Px that a frame is rendered larger than asked for, as `core.pipeline.views` does it for the same twin's pictures:
#: the projection of what lies beside the frame depends on its size.
_MARGIN = 3
#: Rows that are worth a call to a thread.
_GRAIN = 16


def draw(stage: Stage, view: View, area: SharedArea) -> Drawn:
    """Renders a view into shared memory.

    Raises:
        DgsError: there is not enough memory to share.
    """
    began, camera = time.perf_counter(), view.camera
    drawn = Drawn(camera.width, camera.height, view.depth, 0.0, stage.missing(view.twins))
    pixels, depths = drawn.planes(area.view(drawn.bytes))
    staged = stage.staged(view.twins)
    rendered = None if staged is None else _rendered(staged, view)
    if staged is None or rendered is None:
        _empty(view, pixels, depths)
    else:
        none = np.zeros((0, 0), np.float32)
        image, alpha = rendered.image.cpu().numpy(), rendered.alpha.cpu().numpy()
        depth = none if rendered.depth is None else rendered.depth.cpu().numpy()
        curve = view.light, np.float32(view.power), view.background is not None
        options = _MARGIN, decoding_table(), *curve, np.float32(staged.unit), np.float32(view.solid)
        run(
            pack, camera.height, image, alpha, depth, *options, pixels, none if depths is None else depths, grain=_GRAIN
        )
    return Drawn(drawn.width, drawn.height, drawn.depth, time.perf_counter() - began, drawn.missing)


def _rendered(staged: Staged, view: View) -> Rendered | None:
    own = staged.camera(view.camera)
    near = staged.near(own)
    if near is None:
        return None
    device = staged.gaussians.means.device
    behind = None if view.background is None else torch.tensor(view.background, device=device)
    settings = RasterSettings(near=near, depth=view.depth)
    with torch.no_grad():
        return sharp_view(staged.gaussians, own.with_margin(_MARGIN), settings, behind)


def _empty(view: View, pixels: np.ndarray, depths: np.ndarray | None) -> None:
    """What is seen where no twin is."""
    pixels[:] = 0.0
    if view.background is not None:
        colour = np.array(view.background, np.float32)
        if view.light:
            at = np.arange(len(decoding_table())) / (len(decoding_table()) - 2)
            colour = np.interp(colour, at, decoding_table()).astype(np.float32)
        pixels[..., :3], pixels[..., 3] = colour, 1.0
    if depths is not None:
        depths[:] = NOWHERE
