"""The weights of a photo's kernel that explain it best: `training.optics.kernels` says what F is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from ...imaging.formation.kernel_convolution import places
from ...imaging.formation.kernels import KERNELS
from ...numbers import BY_DEFINITION, number

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


def places_of_weights() -> Array:
    """[K, 2] x and y of the light as it is, then of the tents, in distances between them."""
    return np.vstack([np.zeros((1, 2)), places(KERNELS.side, torch.zeros(1, dtype=torch.float64)).numpy()])


def best_weights(
    matrix: Array, vector: Array, settings: LearnedKernelsSettings = SETTINGS, price: float | None = None
) -> Array | None:
    """[K] weights of the least F, of which `matrix` [K, K] and `vector` [K] are the photo's part; None without any.

    Args:
        price: of width, instead of the settings' own.
    """
    at, price = places_of_weights(), settings.price if price is None else price
    held = settings.firm * (np.ones((len(at), len(at))) + at @ at.T)
    pull = settings.firm * np.ones(len(at)) - price * (at**2).sum(axis=1)
    total = matrix + held + 1e-6 * np.eye(len(at))
    root = np.linalg.cholesky(total)
    weights: Array = nnls(root.T, np.linalg.solve(root, vector + pull))[0]
    return weights / weights.sum() if weights.sum() > 0 else None
