"""Field-dependent blur: the lens is sharpest in one part of the frame, mostly the middle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.effect import Shot
from ..imaging.formation.spreading import SpreadingEffect
from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class FieldBlurSettings:
    """Numbers of the evidence for blur that changes over the frame."""

    smallest_visible: float = number(
        1.0, "px", "standard deviation that the corners have beyond the middle", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    least_error: float = number(0.1, "px", "of the estimate: the law itself is no more certain")


SETTINGS = FieldBlurSettings()


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
            self._add("corner", corner.new_zeros(corner.shape))
            return
        per = 2.0 * corner.to(light) * shot.diagonal**2
        self._add("corner", (in_variance * per * self._shape(self._where(shot, light)[1])).sum())

    def described(self) -> dict[str, object]:
        """Thousandths of the diagonal."""
        return {"corner_per_mille": round(1000 * float(self.parameters["corner"].detach()), 4)}


def inspect(photos: PhotoSet) -> Evidence:
    """Blur of tiles against their distance from the photo's middle."""
    smallest = SETTINGS.smallest_visible
    local = photos.local_blur
    if local is None:
        return unknown("field_blur", "px", smallest, "Not measured: too few tiles hold enough detail")
    value = math.sqrt(abs(local.corner))
    error = max(local.corner_error / max(2 * value, 1.0), SETTINGS.least_error)
    where = "corners are blurrier than the middle" if local.corner > 0 else "middle is blurrier than the corners"
    return judged("field_blur", value, error, smallest, "px", f"The {where} by {value:.2f} px (sigma)")


def build(photos: PhotoSet) -> FieldBlur | None:
    """What the tiles show beyond the blur that they share, which is the medium's."""
    import numpy as np  # late: the command line's help reads this file
    import torch  # heavy

    local = photos.local_blur
    if local is None:
        return None
    diagonal = math.hypot(*photos.greys[0].shape)
    # What noise alone gives is taken off, so that nothing is simulated where nothing is seen.
    certain = 1.0 - min(1.0, (local.corner_error / max(abs(local.corner), 1e-9)) ** 2)
    corner = np.sign(local.corner) * np.sqrt(abs(local.corner) * certain)
    return FieldBlur(torch.tensor(float(corner) / diagonal))


SPEC = EffectSpec(
    name="field_blur",
    physics=FieldBlur.physics,
    words=EffectWords(
        label="Blurred Corners",
        tooltip="A lens that is less sharp towards the corners of the frame, or towards its middle",
        simulated="Blur that grows towards the corners (or the middle) of the frame, in every step.",
        missing="Blur that changes over the frame",
        blurred="blurred towards the corners",
    ),
    inspect=inspect,
    switch=Switch(
        speakers=("field_blur",),
        trial_rank=6,
        simulation=FieldBlur,
        build=build,
        confirmed_by="points",
        unmeasured="too few regions hold detail",
    ),
)
