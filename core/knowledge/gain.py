"""How much a photo would tell: expected information through the blur.

    gain = 1/2 sum over px of log2(1 + v / s^2) / patch        [bits]

v is the variance of the BLURRED px over samples of what is still open, s the photos' noise, and patch the
number of px that the blur ties together (1 / sum h^2). Detail that the blur would hide anyway brings nothing.
Px are taken as independent beyond that, so the figure ranks views; it is no exact count of bits.

What was seen from one side says less about another: a splat's colour seen from angle a off its nearest photo
is correlated with what that photo saw by exp(-(a / 35 deg)^2), the rest is open. So the far side of a
shell, whose splats look known from the front, counts as unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..constants import SH_C0
from ..rasterizer import render
from .looks import COLOUR, Looks, Place
from .posterior import Posterior

#: Angle (radians) after which a surface seen from another side is mostly open: relief, gloss, occlusion.
TURN = np.radians(35.0)


@dataclass(frozen=True)
class Gain:
    """What one more photo would tell.

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


def carried(looks: Looks, posterior: Posterior, taken: Sequence[Place], place: Place) -> Tensor:
    """[N] correlation of what `place` sees of each Gaussian with what the photos saw of it."""
    means = looks.gaussians.means.double()

    def towards(p: Place) -> Tensor:
        rays = torch.from_numpy(p.camera.centre) - means
        return rays / rays.norm(dim=1, keepdim=True).clamp(min=1e-12)

    here = towards(place)
    nearest = torch.full((len(means),), -1.0, dtype=torch.float64)
    for index, photo in enumerate(taken):
        cosine = torch.where(posterior.seen[index], (towards(photo) * here).sum(dim=1), -1.0)
        nearest = torch.maximum(nearest, cosine)
    angle = torch.arccos(nearest.clamp(-1.0, 1.0))
    return torch.exp(-((angle / TURN) ** 2)).float()


def opened(looks: Looks, posterior: Posterior, taken: Sequence[Place], place: Place) -> Tensor:
    """[S, N, 3] samples of what is open as seen from `place`."""
    share = carried(looks, posterior, taken, place)[None, :, None]
    generator = torch.Generator().manual_seed(12345)
    fresh = torch.randn(posterior.steps.shape, generator=generator)
    return share.sqrt() * posterior.steps + (1.0 - share).sqrt() * fresh


def spread(looks: Looks, steps: Tensor, place: Place) -> tuple[Tensor, Tensor]:
    """Variance over samples of the photo [3, H, W], and of the sharp frame [3, H + 2m, W + 2m]."""
    blurred, sharp = torch.zeros(()), torch.zeros(())
    for step in steps:
        change = looks.sharp_change(step, place)
        sharp = sharp + change.square() / len(steps)
        blurred = blurred + looks.blur(place).apply(change).square() / len(steps)
    return blurred, sharp


def gain_of(
    looks: Looks,
    posterior: Posterior,
    taken: Sequence[Place],
    place: Place,
    spreads: tuple[Tensor, Tensor] | None = None,
) -> Gain:
    """The expected gain of a photo at `place`, given photos at `taken`; `spreads` there, where they are at hand."""
    blurred, sharp = spreads or spread(looks, opened(looks, posterior, taken, place), place)
    patch = 1.0 if place.psf is None else 1.0 / float(np.square(place.psf.kernel()).sum())
    bits = 0.5 * float(torch.log2(1.0 + blurred / posterior.noise**2).sum()) / patch
    fall = float((blurred.square() / (blurred + posterior.noise**2)).sum()) / patch
    if not np.isfinite(bits + fall):
        bits = fall = 0.0
    shown = _alpha(looks, place) > 0.5
    limit = 0.5 * COLOUR**2
    m = looks.margin
    inner = sharp.mean(dim=0)[m : m + shown.shape[0], m : m + shown.shape[1]]
    guessed = float((inner[shown] > limit).float().mean()) if bool(shown.any()) else 1.0
    return Gain(bits, fall, guessed, float(shown.float().mean()))


def told(looks: Looks, posterior: Posterior, taken: Sequence[Place], place: Place) -> Tensor:
    """[H, W] how far the photos tell what `place` sees: the splats' `carried`, blended; 0 where there is none."""
    sh = torch.zeros_like(looks.gaussians.sh)
    sh[:, 0] = ((carried(looks, posterior, taken, place) - 0.5) / SH_C0)[:, None]
    with torch.no_grad():
        shown = render(replace(looks.gaussians, sh=sh), place.camera, settings=looks.settings).image[0]
    return shown.clamp(0.0, 1.0)


def _alpha(looks: Looks, place: Place) -> Tensor:
    with torch.no_grad():
        return render(looks.gaussians, place.camera, settings=looks.settings).alpha
