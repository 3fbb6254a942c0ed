"""No Gaussian is finer than the sharpest photo of it can show.

What no photo has in focus is a wide spot in all of them, and fragments finer than such a spot explain it as well as
what is there: an inverse blur without an end. So a Gaussian's standard deviations are held at a share of the
narrowest blur that any photo has at its place. (Mip-Splatting, Yu et al. 2024, bounds them by the photos' sampling;
here it is their blur that bounds.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from ...gaussians import Gaussians
from ...imaging.formation.focus import Focus, FocusBlur
from ...numbers import BY_DEFINITION, number
from ..grid import GridView
from .footprint import seen_in


@dataclass(frozen=True)
class FinestSettings:
    """How fine a Gaussian may be."""

    share: float = number(
        1.0,
        "of the blur's standard deviation",
        "that a Gaussian's standard deviations are at least: it passes a sixth of its contrast at the spot's first"
        " zero (0.305 cycles per standard deviation of the disk), beyond which contrasts are inverted or gone",
        "by that argument; drinks, held-out photos: 24.4 dB without, 24.5 with 0.5, 25.0 with 1",
        "an orrery rendered with foci before its far half: 27.54, 27.83 with 1, 27.97 with 1.5; a shelf so: 22.72,"
        " 22.73",
    )
    out_of_focus: float = number(
        1.0, "px of the photo", "of blur (standard deviation) from which on a place is out of focus", BY_DEFINITION
    )


FINEST = FinestSettings()


@dataclass(frozen=True)
class Narrowest:
    """The narrowest blur (standard deviation) that a photo has at each place; on the host.

    Attributes:
        size: [N] in the world's units; infinite where no photo sees the place: none says anything about it.
        px: [N] the same in px of the grid.
    """

    size: torch.Tensor
    px: torch.Tensor

    def out_of_focus(self, step: int) -> int:
        """How many places all photos that see them have out of focus; of a grid of `step` photo px."""
        return int((self.px.isfinite() & (step * self.px >= FINEST.out_of_focus)).sum())


def narrowest_blur(means: torch.Tensor, views: Sequence[GridView], focus: FocusBlur) -> Narrowest:
    """Asks all photos.

    Args:
        means: [N, 3] places. views: photos on one grid; focus: of each, learned in the same world.
    """
    means = means.detach().cpu()
    size = torch.full_like(means[:, 0], torch.inf)
    px = size.clone()
    for view in views:
        camera = view.camera
        z, seen = seen_in(means, camera)
        width = _width(focus.of(view.name), focus, z, math.hypot(camera.width, camera.height))
        narrower = seen & (width * z / camera.fx < size)
        size, px = torch.where(narrower, width * z / camera.fx, size), torch.where(narrower, width, px)
    return Narrowest(size, px)


def _width(values: Focus | None, focus: FocusBlur, depth: torch.Tensor, diagonal: float) -> torch.Tensor:
    """[N] standard deviation (px) in a photo at each depth; 0 in one that has no blur of its own."""
    if values is None:
        return torch.zeros_like(depth)
    strength, at = (depth.new_tensor(value) for value in (values.strength, values.focus))
    return focus.spread(strength, at, depth, diagonal).abs()


def hold_sizes(gaussians: Gaussians, narrowest: torch.Tensor) -> int:
    """Makes what is finer than the sharpest photo shows as large as that; returns how many.

    Args:
        gaussians: changed in place, on any device. narrowest: [N] on the host, `Narrowest.size`.
    """
    with torch.no_grad():
        bounded = narrowest.isfinite() & (narrowest > 0)
        least = torch.where(bounded, torch.log(FINEST.share * narrowest), torch.full_like(narrowest, -torch.inf))
        log_scales = gaussians.log_scales.detach().cpu()
        found = int((log_scales.amin(dim=1) < least).sum())
        if found:
            gaussians.log_scales.copy_(torch.maximum(log_scales, least[:, None]))
    return found
