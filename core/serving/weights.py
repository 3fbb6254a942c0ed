"""How much a camera sees of each Gaussian: the weights that it is blended with, summed over the frame."""

from __future__ import annotations

import numpy as np

from ..rasterizer import RasterSettings
from ..training.density.contribution import seen_by
from .messages import View
from .shared_area import SharedArea
from .stage import Stage


def weigh(stage: Stage, view: View, area: SharedArea) -> int:
    """Writes px, one float32 for each Gaussian that the twins show, in their order, into shared memory.

    Returns:
        How many Gaussians there are.

    Raises:
        DgsError: there is not enough memory to share.
    """
    staged = stage.staged(view.twins)
    if staged is None:
        return 0
    count = len(staged.gaussians)
    weights = np.frombuffer(area.view(4 * count), np.float32, count)
    camera = staged.camera(view.camera)
    near = staged.near(camera)
    if near is None:
        weights[:] = 0.0
    else:
        seen = seen_by(staged.gaussians, [(camera, None)], RasterSettings(near=near)).contribution
        weights[:] = seen.cpu().numpy()
    return count
