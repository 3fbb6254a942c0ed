"""Each photo's own kernel, learned with the Gaussians.

Whenever a photo is visited, its kernel takes a part of the way to the one that explains the photo best, the twin as it
is. A photo is linear in the weights of its kernel, so that the best one is a non-negative least squares problem,

    F(w) = n mean omega (c'(L) (y - B w))^2 / 2 s^2 + price w . r^2,    w >= 0,    sum of w = 1,    w . p = 0,

with B the twin's light through each tent, y the photo in linear light, c' the slope of the sRGB curve, omega Huber's
weights, s the noise as it shows, and p and r the tents' places and distances from the middle. The middle of every
kernel's light stays in the middle: beside it, a camera that stands elsewhere would look the same. Width that all photos
share is the twin's rather than theirs: the price takes it from them. So the sharpest photos say how sharp the scene is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...colour import encoding_derivative, linear_to_srgb, srgb_to_linear
from ...forward import Exposed
from ...imaging.formation.kernel_convolution import seen_through_tents
from ...imaging.formation.kernels import KERNELS, PhotoKernels
from .kernel_errors import errors_of, tile_of
from .kernel_weights import SETTINGS, LearnedKernelsSettings, best_weights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SeenThroughTents:
    """A photo's problem of least squares at P values (channels, rows, columns), in display values to first order.

    Attributes:
        jacobian: [K, P]; target: [P]; trust: [P] Huber's weights over the noise, as if of so many independent px.
        tiles: [P] which tile of the photo each value lies in.
    """

    jacobian: Tensor
    target: Tensor
    trust: Tensor
    tiles: Tensor

    @staticmethod
    def of(
        through: Tensor, photo: Tensor, weights: Tensor, counts: Tensor | None, settings: LearnedKernelsSettings
    ) -> SeenThroughTents:
        """Of the light through each tent [3, K, h, w], the photo [3, h, w] and the kernel [K] as it is."""
        wanted = srgb_to_linear(photo.clamp(0.0, 1.0))
        shown = torch.einsum("ckhw,k->chw", through, weights).clamp(min=0.0)
        slope = encoding_derivative(shown, linear_to_srgb(shown))
        rest = (linear_to_srgb(wanted) - linear_to_srgb(shown)).reshape(-1).double()
        weight = torch.ones_like(rest)
        if counts is not None:
            weight = counts.expand(3, *counts.shape).reshape(-1).to(rest)
        limit = max(settings.huber * 1.4826 * float(rest.abs().median()), 1e-3)
        weight = weight * (limit / rest.abs().clamp(min=1e-12)).clamp(max=1.0)
        noise = float((weight * rest.square()).sum() / weight.sum().clamp(min=1.0))
        trust = settings.independent / max(float(weight.numel()), 1.0) / max(noise, 1e-8)
        jacobian = (through * slope[:, None]).transpose(0, 1).reshape(through.shape[1], -1).double()
        target = (wanted * slope).reshape(-1).double()
        tiles = torch.from_numpy(tile_of(*photo.shape[1:])).expand(3, *photo.shape[1:]).reshape(-1).to(rest.device)
        return SeenThroughTents(jacobian, target, weight * trust, tiles)

    def normal_equations(self) -> tuple[Array, Array]:
        """[K, K] and [K] of F without its last terms."""
        weighted = self.jacobian * self.trust
        return (weighted @ self.jacobian.T).cpu().numpy(), (weighted @ self.target).cpu().numpy()

    def slopes(self, weights: Array) -> Array:
        """[T, K] how F falls with each weight in each tile, at some weights [K]."""
        rest = self.target - torch.from_numpy(weights).to(self.target) @ self.jacobian
        of_px = (self.jacobian * (self.trust * rest)).T
        tiles = of_px.new_zeros(int(self.tiles.max()) + 1, of_px.shape[1])
        return tiles.index_add(0, self.tiles, of_px).cpu().numpy()


class LearnedKernels:
    """Kernels of photos, fitted and held-out ones.

    Args:
        start: for the photos that they are to be learned of, where learning begins.

    Attributes:
        effect: as it is; the forward model's own, so that it sees every step.
    """

    def __init__(self, start: PhotoKernels, settings: LearnedKernelsSettings = SETTINGS) -> None:
        self.settings = settings
        self.effect = PhotoKernels(start.names, start.parameters["weights"].detach().clone().cpu())

    def learn(self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None = None) -> None:
        """Takes a part of the way to the kernel that explains a photo best.

        Args:
            photo: [3, H, W] sRGB on the grid, without its exposure; counts: [H, W] bool, None for all px.
        """
        row = self.effect.row_of(name)
        if row is None:
            return
        matrix, vector = self.normal_equations(exposed, photo, counts)
        if not (np.isfinite(matrix).all() and np.isfinite(vector).all()):
            return
        found = best_weights(matrix, vector, self.settings)
        if found is None:
            return
        weights = self.effect.parameters["weights"]
        weights[row] += self.settings.part * (torch.from_numpy(found).to(weights) - weights[row])

    def measure(self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None = None) -> None:
        """Finds how well a photo determines its kernel, on the finished twin; arguments as of `learn`."""
        row = self.effect.row_of(name)
        if row is None:
            return
        seen = self._seen(exposed, photo, counts)
        matrix, vector = seen.normal_equations()
        if not (np.isfinite(matrix).all() and np.isfinite(vector).all()):
            return
        best = best_weights(matrix, vector, self.settings)
        if best is None:
            return
        now = self.effect.parameters["weights"][row].double().numpy()
        found = errors_of(matrix, vector, seen.slopes(best), now, self.settings)
        if found is not None:
            self.effect.errors[row] = torch.from_numpy(found.weights).to(self.effect.errors)
            self.effect.variance_errors[row] = found.variance

    def normal_equations(self, exposed: Exposed, photo: Tensor, counts: Tensor | None) -> tuple[Array, Array]:
        """[K, K] and [K] of F without its last terms: half of w . matrix w - vector . w."""
        return self._seen(exposed, photo, counts).normal_equations()

    def _seen(self, exposed: Exposed, photo: Tensor, counts: Tensor | None) -> SeenThroughTents:
        """The photo, and the twin's light through each tent, at the px looked at."""
        s, total = self.settings, None
        every = max(1, round(math.sqrt(photo.shape[1] * photo.shape[2] / s.looked_at)))
        for passage, share in exposed.passages:
            at = next(i for i, effect in enumerate(passage.effects) if effect is self.effect)
            shot = passage.shot
            light = passage.stages[at].detach()
            seen = seen_through_tents(light, shot.margin, KERNELS.side, KERNELS.pitch * shot.diagonal, every) * share
            total = seen if total is None else total + seen
        assert total is not None
        thin = (..., slice(every // 2, None, every), slice(every // 2, None, every))
        weights = self.effect.parameters["weights"][self.effect.row_of(exposed.shot.name)].to(total)
        counted = None if counts is None else counts[thin]
        return SeenThroughTents.of(total, photo[thin], weights, counted, s)

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        return {"kernels": self.effect.parameters["weights"].double().numpy()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        kept = arrays.get("kernels")
        weights = self.effect.parameters["weights"]
        if kept is None or kept.shape != tuple(weights.shape) or not np.isfinite(kept).all():
            return False
        weights.copy_(torch.from_numpy(kept.astype(np.float32)))
        return True
