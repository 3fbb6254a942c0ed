"""How much a photo would add: expected information through the blur.

    gain = 1/2 sum over px of log2(1 + v / s^2) / patch        [bits]

v is the variance of the BLURRED px over samples of what is still open, s the photos' noise, and patch the
number of px that the blur ties together (1 / sum h^2). Detail that the blur would hide anyway brings nothing.
Px are taken as independent beyond that, so the figure ranks views; it is no exact count of bits.

What was seen from one side says less about another: a splat's colour seen from angle a off its nearest photo
is correlated with what that photo saw by exp(-(a / 35 deg)^2), the rest is open. So the far side of a
shell, whose splats seem determined from the front, counts as unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..constants import SH_C0
from ..numbers import number
from .linear_model import PRIOR, LinearModel, Viewpoint
from .posterior import Posterior


@dataclass(frozen=True)
class InformationGainSettings:
    """How far what was seen carries, and what counts as guessed."""

    turn: float = number(
        35.0, "deg", "angle after which a surface seen from another side is mostly open: relief, gloss, occlusion"
    )
    guessed_share: float = number(
        0.5, "share of the prior's variance", "from which a px is guessed: photos say less of it than they leave open"
    )


DEFAULTS = InformationGainSettings()


@dataclass(frozen=True)
class InformationGain:
    """What one more photo would add.

    Attributes:
        bits: expected information.
        fall: by how much the photo's px are expected to be less open: sum of their variance, less what stays open.
        guessed: share of the px showing the twin whose sharp colour is open: half the prior's variance or more.
        covered: share of the px that show the twin at all.
    """

    bits: float
    fall: float
    guessed: float
    covered: float


def carried(linear: LinearModel, posterior: Posterior, taken: Sequence[Viewpoint], viewpoint: Viewpoint) -> Tensor:
    """[N] correlation of what `viewpoint` sees of each Gaussian with what the photos saw of it."""
    means = linear.gaussians.means.double()

    def towards(p: Viewpoint) -> Tensor:
        rays = torch.from_numpy(p.camera.centre) - means
        return rays / rays.norm(dim=1, keepdim=True).clamp(min=1e-12)

    here = towards(viewpoint)
    nearest = torch.full((len(means),), -1.0, dtype=torch.float64)
    for index, photo in enumerate(taken):
        cosine = torch.where(posterior.seen[index], (towards(photo) * here).sum(dim=1), -1.0)
        nearest = torch.maximum(nearest, cosine)
    angle = torch.arccos(nearest.clamp(-1.0, 1.0))
    return torch.exp(-((angle / np.radians(DEFAULTS.turn)) ** 2)).float()


def opened(linear: LinearModel, posterior: Posterior, taken: Sequence[Viewpoint], viewpoint: Viewpoint) -> Tensor:
    """[S, N, 3] samples of what is open as seen from `viewpoint`."""
    share = carried(linear, posterior, taken, viewpoint)[None, :, None]
    generator = torch.Generator().manual_seed(12345)
    fresh = torch.randn(posterior.steps.shape, generator=generator)
    return share.sqrt() * posterior.steps + (1.0 - share).sqrt() * fresh


def spread(linear: LinearModel, steps: Tensor, viewpoint: Viewpoint) -> tuple[Tensor, Tensor]:
    """Variance over samples of the photo [3, H, W], and of the sharp frame [3, H + 2m, W + 2m]."""
    blurred, sharp = torch.zeros(()), torch.zeros(())
    for step in steps:
        change = linear.sharp_change(step, viewpoint)
        sharp = sharp + change.square() / len(steps)
        blurred = blurred + linear.blurred(change, viewpoint).square() / len(steps)
    return blurred, sharp


def gain_of(
    linear: LinearModel,
    posterior: Posterior,
    taken: Sequence[Viewpoint],
    viewpoint: Viewpoint,
    spreads: tuple[Tensor, Tensor] | None = None,
) -> InformationGain:
    """The expected gain of a photo at `viewpoint`, given photos at `taken`; `spreads` there, where they are at hand."""
    blurred, sharp = spreads or spread(linear, opened(linear, posterior, taken, viewpoint), viewpoint)
    patch = 1.0 if viewpoint.psf is None else 1.0 / float(np.square(viewpoint.psf.kernel()).sum())
    bits = 0.5 * float(torch.log2(1.0 + blurred / posterior.noise**2).sum()) / patch
    fall = float((blurred.square() / (blurred + posterior.noise**2)).sum()) / patch
    if not np.isfinite(bits + fall):
        bits = fall = 0.0
    shown = _alpha(linear, viewpoint) > 0.5
    limit = DEFAULTS.guessed_share * PRIOR.colour**2
    m = linear.margin
    inner = sharp.mean(dim=0)[m : m + shown.shape[0], m : m + shown.shape[1]]
    guessed = float((inner[shown] > limit).float().mean()) if bool(shown.any()) else 1.0
    return InformationGain(bits, fall, guessed, float(shown.float().mean()))


def observed_share(
    linear: LinearModel, posterior: Posterior, taken: Sequence[Viewpoint], viewpoint: Viewpoint
) -> Tensor:
    """[H, W] how far photos determine what `viewpoint` sees: the splats' `carried`, blended; 0 where none is."""
    sh = torch.zeros_like(linear.gaussians.sh)
    sh[:, 0] = ((carried(linear, posterior, taken, viewpoint) - 0.5) / SH_C0)[:, None]
    with torch.no_grad():
        shown = linear.seen(viewpoint, sh).image[0]
    return shown.clamp(0.0, 1.0)


def _alpha(linear: LinearModel, viewpoint: Viewpoint) -> Tensor:
    with torch.no_grad():
        return linear.seen(viewpoint, linear.gaussians.sh).alpha
