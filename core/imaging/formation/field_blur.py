"""Field-dependent blur: the lens is sharpest in one part of the frame, mostly the middle."""

from __future__ import annotations

import torch
from torch import Tensor

from .effect import Shot
from .layered import SpreadingEffect


class FieldBlur(SpreadingEffect):
    """The light of a px spreads with variance corner^2 r^2, r = distance from the middle over half the diagonal.

    corner: [] standard deviation in the corner as a share of the photo's diagonal, so that it is the same on every
    grid. A negative one means a middle that is blurrier than the corners: corner^2 (1 - r^2), sharp in the corner.
    Only what differs over the frame is simulated: what all px share belongs to the medium's point spread.
    """

    name = "field_blur"
    physics = "Coma, astigmatism and field curvature widen the image of a point with its distance from the lens's axis."

    def __init__(self, corner: Tensor) -> None:
        super().__init__({"corner": corner})

    def spread(self, depth: Tensor, r2: Tensor, diagonal: float) -> Tensor:
        """See `SpreadingEffect`."""
        return (self.parameters["corner"].to(r2) * diagonal) ** 2 * self._shape(r2)

    def reach(self, diagonal: float) -> float:
        """See `Effect`."""
        return diagonal * max(0.0, float(self.parameters["corner"].detach()))

    def _shape(self, r2: Tensor) -> Tensor:
        """Variance in units of the corner's (or, if negative, the middle's)."""
        return r2 if float(self.parameters["corner"].detach()) >= 0 else (1.0 - r2).clamp(min=0.0)

    def add_gradients(self, in_variance: Tensor | None, shot: Shot, light: Tensor) -> None:
        """See `SpreadingEffect`."""
        corner = self.parameters["corner"]
        if in_variance is None:
            self._add("corner", torch.zeros_like(corner))
            return
        per = 2.0 * corner.to(light) * shot.diagonal**2
        self._add("corner", (in_variance * per * self._shape(self._where(shot, light)[1])).sum())

    def described(self) -> dict[str, object]:
        """Thousandths of the diagonal."""
        return {"corner_per_mille": round(1000 * float(self.parameters["corner"].detach()), 4)}
