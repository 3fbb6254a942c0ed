"""How strong the differences of a scene are, estimated from its blurred photos: the unit of what a loss calls large.

A twin must not depend on how bright or contrasty its photos are, so sizes of differences in the loss are
given in units of the scene's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ...forward import shared_medium
from ...frames import Frame
from ..grid import GridView

#: Photos without any structure still have one 8-bit step.
MINIMUM_CONTRAST = 1.0 / 255.0


def scene_contrast(views: Sequence[GridView]) -> float:
    """Mean difference between neighbouring grid px of the sharp scene, sRGB in [0, 1], as the photos let expect.

    A linear filter lowers the differences of a scene whose spectrum falls as 1/f, as natural ones do (Field 1987),
    by the root of the sum of its squared kernel (Parseval). Photos are blurred by their own PSF once more
    before their differences are taken, so that noise hardly counts.
    """
    found = []
    for view in views:
        planes = torch.from_numpy(view.planes())
        lowered = 1.0
        if view.psf is not None:
            kernel = view.psf.kernel()
            # Of the kernel with itself, by Parseval; padded, or it would wrap around.
            power = np.abs(np.fft.fft2(kernel, [2 * n for n in kernel.shape])) ** 4
            lowered = float(np.sqrt(power.mean()))
            planes = shared_medium(view.psf, Frame(planes.shape[1], planes.shape[2], 0)).degraded(planes)
        right = planes[:, :-1, 1:] - planes[:, :-1, :-1]
        down = planes[:, 1:, :-1] - planes[:, :-1, :-1]
        difference = (right.square().sum(dim=0) + down.square().sum(dim=0)).sqrt()
        counted = difference[torch.from_numpy(view.valid[:-1, :-1])] if view.valid is not None else difference
        counted = counted[torch.isfinite(counted)]
        if len(counted):
            found.append(float(counted.mean()) / lowered)
    return max(float(np.mean(found)), MINIMUM_CONTRAST) if found else MINIMUM_CONTRAST
