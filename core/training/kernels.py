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
from scipy.optimize import nnls
from torch import Tensor

from ..colour import encoding_derivative, linear_to_srgb, srgb_to_linear
from ..forward import Exposed
from ..imaging.formation.kernel_convolution import places, seen_through_tents
from ..imaging.formation.kernels import KERNELS, PhotoKernels
from ..numbers import BY_DEFINITION, number

Array = NDArray[np.float64]

#: What most of the numbers below rest on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class LearnedKernelsSettings:
    """Numbers of the kernels that are learned."""

    begin: float = number(
        0.05, "share of the run", "from which on kernels are learned: before, the twin is a fog", _FIRST
    )
    coarse_share: float = number(0.5, "share of the run", "on the grid of half the resolution at least", _FIRST)
    part: float = number(0.3, "share of the way", "that is taken at each visit: the twin changes, too", _FIRST)
    independent: float = number(400.0, "px", "that a photo's px count as: neighbours err alike", _FIRST)
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count as their size (95 % efficient on normal noise)",
        BY_DEFINITION,
    )
    looked_at: int = number(8_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)
    price: float = number(
        0.5, "natural log per squared distance of tents", "of width: what all photos share is the twin's", _FIRST
    )
    firm: float = number(
        1e4,
        "natural log",
        "that a kernel's sum off 1, or its middle off by one distance of tents, costs",
        BY_DEFINITION,
    )
    unseen_visits: int = number(6, "visits", "of a photo that is held out, on the finished twin", _FIRST)


SETTINGS = LearnedKernelsSettings()


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

    def normal_equations(self, exposed: Exposed, photo: Tensor, counts: Tensor | None) -> tuple[Array, Array]:
        """[K, K] and [K] of F without its last terms: half of w . matrix w - vector . w."""
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
        wanted = srgb_to_linear(photo[thin].clamp(0.0, 1.0))
        weights = self.effect.parameters["weights"][self.effect.row_of(exposed.shot.name)].to(total)
        shown = torch.einsum("ckhw,k->chw", total, weights).clamp(min=0.0)
        slope = encoding_derivative(shown, linear_to_srgb(shown))
        rest = (linear_to_srgb(wanted) - linear_to_srgb(shown)).reshape(-1).double()
        weight = torch.ones_like(rest)
        if counts is not None:
            weight = counts[thin].expand(3, *counts[thin].shape).reshape(-1).to(rest)
        limit = max(s.huber * 1.4826 * float(rest.abs().median()), 1e-3)
        weight = weight * (limit / rest.abs().clamp(min=1e-12)).clamp(max=1.0)
        noise = float((weight * rest.square()).sum() / weight.sum().clamp(min=1.0))
        trust = s.independent / max(float(weight.numel()), 1.0) / max(noise, 1e-8)
        jacobian = (total * slope[:, None]).transpose(0, 1).reshape(total.shape[1], -1).double()
        target = (wanted * slope).reshape(-1).double()
        weighted = jacobian * (weight * trust)
        return (weighted @ jacobian.T).cpu().numpy(), (weighted @ target).cpu().numpy()

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


def best_weights(matrix: Array, vector: Array, settings: LearnedKernelsSettings = SETTINGS) -> Array | None:
    """[K] weights of the least F, of which `matrix` [K, K] and `vector` [K] are the photo's part; None without any."""
    at = np.vstack([np.zeros((1, 2)), places(KERNELS.side, torch.zeros(1, dtype=torch.float64)).numpy()])
    held = settings.firm * (np.ones((len(at), len(at))) + at @ at.T)
    pull = settings.firm * np.ones(len(at)) - settings.price * (at**2).sum(axis=1)
    total = matrix + held + 1e-6 * np.eye(len(at))
    root = np.linalg.cholesky(total)
    weights: Array = nnls(root.T, np.linalg.solve(root, vector + pull))[0]
    return weights / weights.sum() if weights.sum() > 0 else None
