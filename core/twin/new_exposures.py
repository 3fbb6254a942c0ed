"""Exposures of photos that a twin was not trained on, read from the twin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ..colour import srgb_to_linear
from ..imaging.formation.exposure import Exposure
from ..views import View
from .opened import OpenedTwin

#: sRGB values between which px of photo and twin say what a gain is, and the fewest px that do.
_DARKEST, _BRIGHTEST, _FEWEST = 0.05, 0.97, 100
#: Share of a px that must show the object.
_OPAQUE = 0.95


def exposure_with(twin: OpenedTwin, exposure: Exposure, views: Sequence[View]) -> Exposure:
    """The exposures, and those of other views: each channel's median ratio to what the twin shows there.

    Args:
        views: as they were filed.
    """
    more = [view for view in views if view.name not in exposure.names]
    if not more:
        return exposure
    model = twin.model()
    found = []
    for on_grid in twin.on_grid(more, twin.step):
        with torch.no_grad():
            shown = model.expose(twin.scale.to_unit(twin.gaussians), on_grid, twin.background).degraded.cpu().numpy()
        photo = on_grid.planes()
        usable = (photo.max(axis=0) < _BRIGHTEST) & (photo.min(axis=0) > _DARKEST) & (shown.min(axis=0) > _DARKEST)
        if on_grid.valid is not None:
            usable &= on_grid.valid
        if (present := on_grid.present()) is not None:
            usable &= present > _OPAQUE
        if usable.sum() < _FEWEST:
            found.append(np.zeros(3))
            continue
        ratios = np.log(srgb_to_linear(photo[:, usable]) / srgb_to_linear(shown[:, usable]))
        found.append(np.median(ratios, axis=1))
    like = exposure.parameters["log_gains"]
    gains = torch.cat([like, torch.from_numpy(np.stack(found)).to(like)])
    return Exposure([*exposure.names, *(view.name for view in more)], gains)
