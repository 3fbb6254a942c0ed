"""A free blur of every photo's own: a kernel that neither a path of the camera nor a lens explains.

    photo = sum over k of w_k (tent_k * light),    w >= 0,    sum of w = 1

The tents stand on a square lattice around the middle, a share of the photo's diagonal apart, so that a kernel is the
same on every grid; besides them there is the light as it is. The kernel is the same all over the photo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

from ...numbers import BY_DEFINITION, number
from .effect import Effect, Shot

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class KernelSettings:
    """What kernels can be."""

    side: int = number(9, "count", "tents along each side of the lattice; odd, so that one stands in the middle")
    pitch: float = number(
        0.0035, "of the photo's diagonal", "between tents: 2.5 px of 600 x 400, and kernels up to 20 px wide"
    )
    sure: float = number(2.0, "standard errors", "to either side of a width: 95 % of a normal", BY_DEFINITION)
    reach: float = number(
        0.0055, "of the photo's diagonal", "standard deviation that light from beyond the border is kept for"
    )


KERNELS = KernelSettings()


def _mathematics() -> ModuleType:
    from . import kernel_convolution  # heavy: torch

    return kernel_convolution


class PhotoKernels(Effect):
    """Kernels of V photos; photos that are not named pass unchanged.

    `weights` [V, 1 + side^2]: of the light as it is, then of the tents, row by row from the upper left.

    Attributes:
        errors: [V, 1 + side^2] standard errors of the weights, nan where unknown.
        variance_errors: [V] of the mean variance along both axes, squared distances between tents.
    """

    name = "kernels"
    physics = "Whatever smears the light of a whole photo alike convolves it with one kernel."
    place = "light"

    def __init__(self, names: Sequence[str], weights: Tensor) -> None:
        super().__init__({"weights": weights})
        self.names = tuple(names)
        self.errors = weights.new_full(weights.shape, math.nan)
        self.variance_errors = weights.new_full(weights.shape[:1], math.nan)
        self._rows = {name: i for i, name in enumerate(self.names)}

    @classmethod
    def sharp(cls, names: Sequence[str]) -> PhotoKernels:
        """For these photos, without any blur yet."""
        return cls(names, _mathematics().sharp_weights(len(names), KERNELS.side))

    def row_of(self, name: str) -> int | None:
        """Where a photo's kernel stands; None for a photo that passes unchanged."""
        return self._rows.get(name)

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        row = self.row_of(shot.name)
        if row is None:
            return light
        found: Tensor = _mathematics().convolved(light, self.kernel(row, shot.diagonal, light))
        return found

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        row = self.row_of(shot.name)
        if row is None:
            return upstream
        like = self.parameters["weights"]
        whole = like.new_zeros(like.shape)
        in_light, in_weights = _mathematics().gradients(
            upstream, light, self.kernel(row, shot.diagonal, light), KERNELS.side, self._pitch(shot.diagonal)
        )
        whole[row] = in_weights.to(like)
        self._add("weights", whole)
        passed: Tensor = in_light
        return passed

    def kernel(self, row: int, diagonal: float, like: Tensor) -> Tensor:
        """[K, K] a photo's kernel in px of a grid on which its diagonal is this long; K is odd."""
        weights = self.parameters["weights"][row].to(like)
        found: Tensor = _mathematics().kernel_of(weights, KERNELS.side, self._pitch(diagonal))
        return found

    def reach(self, diagonal: float) -> float:
        """See `Effect`: one for all kernels, as frames keep their size while they are learned."""
        return KERNELS.reach * diagonal

    def widths(self) -> dict[str, float]:
        """Root mean square radius along one axis by photo, as a share of its diagonal."""
        spreads = _mathematics().variances(self.parameters["weights"].detach(), KERNELS.side)
        return {name: KERNELS.pitch * float(v) ** 0.5 for name, v in zip(self.names, spreads, strict=True)}

    def described(self) -> Mapping[str, object]:
        """Distance of the tents (share of the diagonal), and by photo weights, their errors, and between which widths.

        `widths` are the root mean square radius along one axis, and the ends of its interval of 95 %, shares of the
        diagonal. What is unknown of a photo is left out.
        """
        weights = self.parameters["weights"].detach()
        photos = {name: _rounded(row) for name, row in zip(self.names, weights.tolist(), strict=True)}
        known = [name for name, error in zip(self.names, self.variance_errors.tolist(), strict=True) if error >= 0]
        errors = {name: _rounded(self.errors[self._rows[name]].tolist()) for name in known}
        widths = {name: _rounded(self._interval(self._rows[name])) for name in known}
        return {"pitch": KERNELS.pitch, "photos": photos, "errors": errors, "widths": widths}

    def _interval(self, row: int) -> list[float]:
        """Width of a photo's kernel, the least and the most that it may be, shares of the diagonal."""
        variance = float(_mathematics().variances(self.parameters["weights"].detach(), KERNELS.side)[row])
        reach = KERNELS.sure * float(self.variance_errors[row])
        ends = (variance, max(variance - reach, 0.0), variance + reach)
        return [KERNELS.pitch * end**0.5 for end in ends]

    @staticmethod
    def _pitch(diagonal: float) -> float:
        return KERNELS.pitch * diagonal


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 5) for value in values]
