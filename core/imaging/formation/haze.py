"""Haze, smoke, turbid water: attenuation and backscatter along the way from the scene to the camera."""

from __future__ import annotations

import torch
from torch import Tensor

from .effect import Effect, Shot


class Haze(Effect):
    """light -> light exp(-beta d) + veil (1 - exp(-beta d)), beta and veil [3], d the depth in median depths.

    (Koschmieder 1924.) The depth is the sharp render's and taken as known: the gradient goes to light, beta and veil.
    """

    name = "haze"
    physics = "The medium absorbs and scatters away a share of the light with every metre, and adds light of its own."
    place = "light"
    by_depth = True
    multiplications = 6

    def __init__(self, attenuation: Tensor, veil: Tensor) -> None:
        super().__init__({"attenuation": attenuation, "veil": veil})

    def _passed(self, shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
        if shot.depth is None:
            raise ValueError("haze needs the render's depth")
        depth = shot.depth.to(like)
        return torch.exp(-self.parameters["attenuation"].to(like)[:, None, None] * depth), depth

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, _ = self._passed(shot, light)
        veil = self.parameters["veil"].to(light)[:, None, None]
        return veil + passed * (light - veil)

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, depth = self._passed(shot, light)
        veil = self.parameters["veil"].to(light)[:, None, None]
        through = upstream * passed
        self._add("attenuation", -(through * depth * (light - veil)).sum(dim=(1, 2)))
        self._add("veil", (upstream - through).sum(dim=(1, 2)))
        return through
