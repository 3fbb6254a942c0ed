"""A photo as it would be without what lens and sensor did to it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ..compositing import blended, unblended
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..views import View


def unfiled_planes(view: View, formation: Formation, shot: Shot) -> NDArray[np.float32]:
    """[3, H, W] the photo with the sensor's effects undone; a background that was put behind it has never seen them."""
    empty, background = view.transparency(), view.background
    if empty is None or background is None:
        return np.asarray(formation.unfiled(torch.from_numpy(view.planes()), shot).numpy(), np.float32)
    straight = torch.from_numpy(unblended(background, view.planes(), empty))
    return blended(background, formation.unfiled(straight, shot).numpy(), empty)
