"""The normal equations of a step of a path, and of what else is asked of a photo: sums over its px."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...compiled import run
from .step_kernels import sum_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PathEquations:
    """What a step of a path solves, and how what else is asked of the photo goes with the path.

    Attributes:
        matrix, vector: [C, C] and [C] float64 of the path's C coefficients, the prior included.
        cross: [E, C] float64 of what else is asked and the path; own, wanted: [E, E] and [E] of what else is asked.
    """

    matrix: Tensor
    vector: Tensor
    cross: Tensor
    own: Tensor
    wanted: Tensor

    def step_of(self, which: slice) -> tuple[Array, Array]:
        """[P, P] precision and [P] vector of a photo's own step of P numbers beside the path, the path following.

        Nothing but zeros where the photo says nothing.
        """
        cross, own, wanted = self.cross[which], self.own[which, which], self.wanted[which]
        along = torch.linalg.solve(self.matrix, torch.cat([cross.T, self.vector[:, None]], dim=1))
        precision, vector = own - cross @ along[:, :-1], wanted - cross @ along[:, -1]
        if not bool(torch.isfinite(precision).all() and torch.isfinite(vector).all()):
            return np.zeros((len(own), len(own))), np.zeros(len(own))
        return precision.numpy(), vector.numpy()


@dataclass(frozen=True)
class SeenPx:
    """A photo's px as a step sees them.

    Attributes:
        right, down: [M + 1, 3, h, w] of the photo by a px's shift of each part of the path.
        flow: [2, 6, h, w] px to the right, and down, by which a px of motion in each axis moves what is seen.
        beside: [E, 3, h, w] of the photo by what else is asked.
        rest: [3, h, w] what is left of the photo.
    """

    right: Tensor
    down: Tensor
    flow: Tensor
    beside: Tensor
    rest: Tensor

    def sums(self, weight: Tensor) -> Tensor:
        """[N, N] float64 of w a a^T over all px; a: the path's 6 (M + 1) coefficients, E others, and what is left.

        Args:
            weight: [3, h, w] of each px and channel.
        """
        height, size = self.rest.shape[1], 6 * len(self.right) + len(self.beside) + 1
        out = np.empty((height, size, size), np.float32)
        arrays = (self.right, self.down, self.flow, self.beside, self.rest, weight)
        run(sum_rows, height, *(array.contiguous().numpy() for array in arrays), out, grain=8)
        upper = torch.from_numpy(out.sum(axis=0, dtype=np.float64))
        return upper.triu() + upper.triu(1).T

    def sums_in_torch(self, weight: Tensor) -> Tensor:
        """The same in plain torch: the specification."""
        values = torch.cat([self.by_path().flatten(0, 1), self.beside, self.rest[None]]).flatten(1)
        return ((values * weight.flatten()) @ values.T).double()

    def by_path(self) -> Tensor:
        """[M + 1, 6, 3, h, w] of the photo by the path's coefficients."""
        (du, dv), each = self.flow[:, :, None], (slice(None), None)
        return -(self.right[each] * du + self.down[each] * dv)
