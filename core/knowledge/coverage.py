"""Which surface is told, seen from where: photos cover pairs of Gaussians and directions.

    value = sum over views e and Gaussians k of W_ke max over photos t of q_kt exp(-(angle_k(t, e) / 35 deg)^2)

q is the share of the prior's spread that one photo takes off a Gaussian's colour, through the blur (diagonal of
Fisher's information, i / (1 + i)); W is how large the Gaussian stands in a view that may be wanted, without the
blur. Bits count px of the photo, so that the nearest camera wins, which shows little of the scene; this counts what of
the scene is told, and prefers a view from elsewhere. It grows less with every photo (it is submodular), so that
choosing the best photo each time comes within 1 - 1/e of the best choice of all (Nemhauser et al. 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from .gain import TURN
from .looks import Looks, Place

#: Random signs by which a diagonal is probed, for three channels each.
PROBES = 3


class Coverage:
    """What photos cover of what may be looked at.

    Args:
        looks: at the twin; noise: standard deviation of a photo's px, sRGB.
        wanted: places from which the twin may be looked at, such as all candidates.
    """

    def __init__(self, looks: Looks, noise: float, wanted: Sequence[Place], seed: int = 0) -> None:
        self.looks, self.noise = looks, noise
        self._generator = torch.Generator().manual_seed(seed)
        self._towards = torch.stack([self._rays(place) for place in wanted])
        self._size = torch.stack([self._diagonal(replace(place, psf=None, valid=None)) for place in wanted])
        self._covered = torch.zeros_like(self._size)
        self._told: dict[int, tuple[Place, Tensor]] = {}

    def take(self, place: Place) -> None:
        """A photo there is taken."""
        self._covered = torch.maximum(self._covered, self._by(place))

    def gain(self, place: Place) -> float:
        """By how much one more photo there raises the share of what is covered, at most 1."""
        more = (self._by(place) - self._covered).clamp(min=0.0)
        return float((self._size * more).sum() / self._size.sum().clamp(min=1e-12))

    def told(self, place: Place) -> Tensor:
        """[N] share of each Gaussian's open colour that a photo there would tell; kept."""
        if id(place) not in self._told:  # (the place is kept too, so that its id stays its own)
            information = self._diagonal(place) / self.noise**2
            self._told[id(place)] = place, information / (1.0 + information)
        return self._told[id(place)][1]

    def _by(self, place: Place) -> Tensor:
        """[E, N] what a photo there covers of what may be looked at."""
        cosine = (self._towards * self._rays(place)).sum(dim=2).clamp(-1.0, 1.0)
        return self.told(place) * torch.exp(-((torch.arccos(cosine) / TURN) ** 2))

    def _rays(self, place: Place) -> Tensor:
        """[N, 3] unit vectors from the Gaussians to the camera."""
        rays = torch.from_numpy(place.camera.centre).float() - self.looks.gaussians.means
        return rays / rays.norm(dim=1, keepdim=True).clamp(min=1e-12)

    def _diagonal(self, place: Place) -> Tensor:
        """[N] mean over the channels."""
        return self.looks.diagonal([place], self._generator, PROBES).mean(dim=1)
