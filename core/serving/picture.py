"""A camera's view of twins, as rows of pixels in memory."""

from __future__ import annotations

import time

import numpy as np
import torch
from numpy.typing import NDArray

from ..compiled import run
from ..forward import sharp_view
from ..forward.collecting import decoding_table
from ..rasterizer import RasterSettings, Rendered
from .messages import Drawn, View
from .packing_kernels import LEAST_ALPHA, NOWHERE, pack
from .shared_area import SharedArea
from .stage import Stage, Staged
from .through import point_spread, through

Plane = NDArray[np.float32]

#: Px that a frame is rendered larger than asked for, as `core.pipeline.views` does it for the same twin's pictures:
#: the projection of what lies beside the frame depends on its size.
_MARGIN = 3
_NONE = np.zeros((0, 0), np.float32)
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
    frame = None if staged is None else _frame(staged, view)
    if staged is None or frame is None:
        _empty(view, pixels, depths)
    else:
        image, alpha, depth = frame
        curve = view.light, np.float32(view.power), view.background is not None
        options = _MARGIN, decoding_table(), *curve, np.float32(staged.unit), np.float32(view.solid)
        run(
            pack,
            camera.height,
            image,
            alpha,
            depth,
            *options,
            pixels,
            _NONE if depths is None else depths,
            grain=_GRAIN,
        )
    return Drawn(drawn.width, drawn.height, drawn.depth, time.perf_counter() - began, drawn.missing)


def _frame(staged: Staged, view: View) -> tuple[Plane, Plane, Plane] | None:
    """Image [3, H + 2m, W + 2m], alpha and blended depth [H + 2m, W + 2m] ([0, 0] for none); m is `_MARGIN`.

    None where nothing lies before the camera.
    """
    psf = None if view.blur is None else point_spread(view.blur)
    reach = 0 if psf is None else max(psf.radius)
    rendered = _rendered(staged, view, _MARGIN + reach)
    if rendered is None:
        return None
    depth = _NONE if rendered.depth is None else rendered.depth.cpu().numpy()
    if psf is None or view.blur is None:
        return rendered.image.cpu().numpy(), rendered.alpha.cpu().numpy(), depth
    image, alpha = through(psf, view.blur, rendered.image, rendered.alpha, view.background is None, reach)
    if depth.size:
        inside = (slice(reach, reach + alpha.shape[0]), slice(reach, reach + alpha.shape[1]))
        depth = _unblurred(depth[inside], rendered.alpha.cpu().numpy()[inside], alpha.cpu().numpy(), staged, view)
    return image.cpu().numpy(), alpha.cpu().numpy(), depth


def _unblurred(depth: Plane, sharp: Plane, blurred: Plane, staged: Staged, view: View) -> Plane:
    """Depths of the sharp picture, multiplied by the blurred one's alpha as `pack` takes them."""
    seen = sharp > max(view.solid, float(LEAST_ALPHA))
    mean = np.where(seen, depth / np.maximum(sharp, np.float32(1e-6)), NOWHERE / np.float32(staged.unit))
    return np.asarray(mean * blurred, np.float32)


def _rendered(staged: Staged, view: View, margin: int) -> Rendered | None:
    own = staged.camera(view.camera)
    near = staged.near(own)
    if near is None:
        return None
    device = staged.gaussians.means.device
    behind = None if view.background is None else torch.tensor(view.background, device=device)
    settings = RasterSettings(near=near, depth=view.depth)
    with torch.no_grad():
        return sharp_view(staged.gaussians, own.with_margin(margin), settings, behind)


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
