"""Defocus: what is nearer or farther than the plane in focus becomes a spot instead of a point."""

from __future__ import annotations

import torch
from torch import Tensor

from .effect import Shot
from .layered import SpreadingEffect

#: Nearest depth (median depths) that blurs by its own: a render's stray nearer ones would blur without bounds.
NEAREST = 0.02


class Defocus(SpreadingEffect):
    """The light of a px at depth d spreads with sigma = strength |1 / d - focus|.

    strength: [] as a share of the photo's diagonal, so that it is the same on every grid; focus: [] 1 / depth of the
    plane in focus. Depths in median depths, strength for 1 / depth in that unit. The depth is the sharp render's and
    taken as known: the gradient goes to light, strength and focus. The spot is taken for a Gaussian.
    """

    name = "defocus"
    physics = "A lens images one distance sharply; its circle of confusion grows linearly in 1 / distance (thin lens)."
    by_depth = True

    def __init__(self, strength: Tensor, focus: Tensor) -> None:
        super().__init__({"strength": strength, "focus": focus})

    def spread(self, depth: Tensor, r2: Tensor, diagonal: float) -> Tensor:
        """See `SpreadingEffect`."""
        return (self.parameters["strength"].to(depth) * diagonal * self._off_focus(depth)) ** 2

    def reach(self, diagonal: float) -> float:
        """See `Effect`: that of what lies half a 1 / (median depth) off the focus, as most of a scene does not."""
        return 0.5 * diagonal * abs(float(self.parameters["strength"].detach()))

    def _off_focus(self, depth: Tensor) -> Tensor:
        return 1.0 / depth.clamp(min=NEAREST) - self.parameters["focus"].to(depth)

    def add_gradients(self, in_variance: Tensor | None, shot: Shot, light: Tensor) -> None:
        """See `SpreadingEffect`."""
        if in_variance is None:
            for name, value in self.parameters.items():
                self._add(name, torch.zeros_like(value))
            return
        off, strength = self._off_focus(self._where(shot, light)[0]), self.parameters["strength"].to(light)
        per = in_variance * off * (2.0 * strength * shot.diagonal**2)
        self._add("strength", (per * off).sum())
        self._add("focus", -(per * strength).sum())

    def described(self) -> dict[str, object]:
        """Strength in thousandths of the diagonal per 1 / median depth, and the depth in focus."""
        strength, focus = (float(self.parameters[name].detach()) for name in ("strength", "focus"))
        return {"strength_per_mille": round(1000 * strength, 4), "focus": round(focus, 5)}
