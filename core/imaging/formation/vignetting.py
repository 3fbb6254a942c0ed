"""Vignetting: the lens passes less light towards the corners."""

from __future__ import annotations

from torch import Tensor

from .effect import Effect, Shot, radius2

#: A lens that passes less than this share of the light in a corner is refused: its inverse would be noise.
LEAST = 0.1


class Vignetting(Effect):
    """light -> (1 - v r^2) light, v [3], r = distance from the middle over half the photo's diagonal.

    The middle passes everything: a common factor cannot be told from a brighter scene. The frame's margin counts as
    the photo's border.
    """

    name = "vignetting"
    physics = "Light that comes in aslant is cut off by the lens barrel and spread over more of the sensor (cos^4)."
    place = "sensor"
    multiplications = 2

    def __init__(self, strength: Tensor) -> None:
        super().__init__({"strength": strength})

    def _passed(self, shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
        r2 = radius2(shot, like)
        return (1 - self.parameters["strength"].to(like)[:, None, None] * r2).clamp(min=LEAST), r2

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return self._passed(shot, light)[0] * light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, r2 = self._passed(shot, light)
        inside = passed > LEAST
        self._add("strength", -(upstream * light * r2 * inside).sum(dim=(1, 2)))
        return passed * upstream

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return light / self._passed(shot, light)[0]
