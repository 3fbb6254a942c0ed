"""Gaussians left out at random, where photos are learned by heart.

Photos that do not agree (moved leaves, other light) or are few can each be explained by Gaussians that conspire before
that photo alone; photos that are held out are then predicted worse and worse. With some Gaussians left out of every
step, at random, none may count on the others (dropout: Srivastava et al. 2014; of Gaussians: Park et al. 2025,
"DropGaussian"). Where photos agree it costs detail, so the photos that are held out decide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..numbers import number


@dataclass(frozen=True)
class DropoutSettings:
    """Whether Gaussians are left out of steps, and how many."""

    gap: float = number(
        2.0,
        "times",
        "the mean squared error of held-out photos over that of fitted ones, from which on Gaussians are left out",
        "in the middle of a run brighton has 5.5, banana 2.3; there it gains",
    )
    begin: float = number(0.3, "share of the run", "before which nothing is judged: surfaces are being found")
    most: float = number(
        0.2,
        "share of the Gaussians",
        "left out of a step at the end of the run; it grows with the share of the run, as in DropGaussian",
        "brighton 0.2, 0.5: 18.35, 18.40 dB; banana 0.2, 0.3, 0.5: 27.83, 27.52, 27.29",
    )
    compared: int = number(4, "photos", "that were fitted are compared, evenly over the set, as many as held-out ones")


DROPOUT = DropoutSettings()
#: Logits by which a Gaussian becomes invisible.
_GONE = -1e3


def learned_by_heart(heldout: float, fitted: float, share: float, settings: DropoutSettings = DROPOUT) -> bool:
    """Whether photos are, given the PSNR (dB) of held-out and of fitted ones, and the share in [0, 1] of the run."""
    return share >= settings.begin and fitted - heldout > 10.0 * math.log10(settings.gap)


def left_out(count: int, share: float, random: np.random.Generator, settings: DropoutSettings = DROPOUT) -> Tensor:
    """[count] float32: what is added to the opacities' logits in a step at a share in [0, 1] of the run.

    Those that stay become more opaque, so that faint ones let through in the mean what they do without.
    """
    rate = settings.most * share
    gone = random.random(count, dtype=np.float32) < rate
    return torch.from_numpy(np.where(gone, np.float32(_GONE), np.float32(-math.log(1.0 - rate))))
