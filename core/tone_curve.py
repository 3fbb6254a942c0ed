"""A camera's own contrast, on top of sRGB's curve (`core.colour`). Loads nothing heavy by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

#: Newton's steps to the inverse of a camera's own curve: five leave less than 1e-5 of curves as they are learned.
NEWTON = 5
#: From which on a camera's curve is worth a word: photos that were rendered in sRGB come to 0.12 (docs/real_blur.md).
_NOTABLE = 0.2


@dataclass(frozen=True)
class ToneCurve:
    """A camera's own contrast. What it files, v in [0, 1], is sRGB's own value u after the inverse of a cubic curve,

        u(v) = v + toe v (1 - v)^2 - shoulder v^2 (1 - v),

    with u'(0) = 1 + toe and u'(1) = 1 + shoulder: where they are above 0, the camera pressed shadows and lights
    together, and drew the values between them apart. Black and white stay; outside [0, 1] the curve goes on straight.
    0 and 0 is sRGB.
    """

    toe: float = 0.0
    shoulder: float = 0.0

    def __bool__(self) -> bool:
        return bool(self.toe or self.shoulder)

    @property
    def notable(self) -> bool:
        """Whether it differs from sRGB by more than what photos leave open."""
        return max(abs(self.toe), abs(self.shoulder)) > _NOTABLE

    def undone(self, filed: Tensor) -> Tensor:
        """SRGB's own values of filed ones, elementwise; differentiable."""
        inside = filed.clamp(0.0, 1.0)
        toe, shoulder = self.parts(inside)
        beyond = filed - inside
        ends = self.toe * beyond.clamp(max=0.0) + self.shoulder * beyond.clamp(min=0.0)
        return filed + self.toe * toe + self.shoulder * shoulder + ends

    def slope(self, filed: Tensor) -> Tensor:
        """Derivative of `undone`."""
        inside = filed.clamp(0.0, 1.0)
        return 1.0 + self.toe * (1 - inside) * (1 - 3 * inside) + self.shoulder * inside * (3 * inside - 2)

    def filed(self, srgb: Tensor) -> Tensor:
        """The inverse of `undone`; not differentiable."""
        found = srgb.clone()
        for _ in range(NEWTON):
            found = found - (self.undone(found) - srgb) / self.slope(found)
        return found

    @staticmethod
    def parts(inside: Tensor) -> tuple[Tensor, Tensor]:
        """Derivatives of `undone` by toe and by shoulder at filed values in [0, 1]."""
        rest = 1 - inside
        return inside * rest * rest, -inside * inside * rest
