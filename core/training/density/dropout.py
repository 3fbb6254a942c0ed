"""Gaussians left out at random, where photos are learned by heart.

Photos that do not agree (moved leaves, other light) or are few can each be explained by Gaussians that conspire before
that photo alone; photos that are held out are then predicted worse and worse. With some Gaussians left out of every
step, at random, none may count on the others (dropout: Srivastava et al. 2014; of Gaussians: Park et al. 2025,
"DropGaussian"). Where photos agree it costs detail, so the photos that are held out decide: they have to get worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...numbers import number

#: What its numbers were chosen on, and what they were checked on.
_CHOSEN = "banana and brighton, which gain; lego (35 photos), the shelf (13) and a village, which would lose"
_CHECKED = "copr, lego (12 photos) and a plant are left alone, a room gains 0.1 dB: docs/studies/splatting.md"


@dataclass(frozen=True)
class DropoutSettings:
    """Whether Gaussians are left out of steps, and how many."""

    gap: float = number(
        2.0,
        "times",
        "the mean squared error of held-out photos over that of fitted ones, from which on Gaussians may be left out",
        _CHOSEN,
        _CHECKED,
    )
    begin: float = number(0.3, "share of the run", "before which nothing is judged: surfaces are being found", _CHOSEN)
    patience: int = number(
        3,
        "evaluations",
        "of held-out photos, all of which are worse than the best before, say that these get worse",
        _CHOSEN,
        _CHECKED,
    )
    loss: float = number(
        0.05,
        "dB on held-out photos",
        "by which all of them have to be worse",
        "as much as is a gain elsewhere (`ScheduleSettings.plateau_gain`)",
        _CHECKED,
    )
    most: float = number(
        0.2,
        "share of the Gaussians",
        "left out of a step at the end of the run; it grows with the share of the run, as in DropGaussian",
        "from the first step, none, 0.2, 0.5: brighton 16.24, 17.02, 16.89 dB, banana 27.40, 27.72, 27.09",
    )
    compared: int = number(4, "photos", "that were fitted are compared, evenly over the set, as many as held-out ones")


DROPOUT = DropoutSettings()
#: Logits by which a Gaussian becomes invisible.
_GONE = -1e3


def getting_worse(scores: Sequence[float], settings: DropoutSettings = DROPOUT) -> bool:
    """Whether held-out photos are explained worse and worse, given all PSNR (dB) so far."""
    before, late = scores[: -settings.patience], scores[-settings.patience :]
    return bool(before) and max(late) < max(before) - settings.loss


def learned_by_heart(heldout: float, fitted: float, settings: DropoutSettings = DROPOUT) -> bool:
    """Whether photos are, given the PSNR (dB) of held-out and of fitted ones."""
    return fitted - heldout > 10.0 * math.log10(settings.gap)


def left_out(count: int, share: float, random: np.random.Generator, settings: DropoutSettings = DROPOUT) -> Tensor:
    """[count] float32: what is added to the opacities' logits in a step at a share in [0, 1] of the run.

    Those that stay become more opaque, so that faint ones let through in the mean what they do without.
    """
    rate = settings.most * share
    gone = random.random(count, dtype=np.float32) < rate
    return torch.from_numpy(np.where(gone, np.float32(_GONE), np.float32(-math.log(1.0 - rate))))
