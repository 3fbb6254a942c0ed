"""Vignetting: the lens passes less light towards the corners, so that the same point darkens there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.effect import Effect, Shot, radius2
from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import NOT_RECORDED, number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class VignettingSettings:
    """Numbers of the evidence for vignetting, and of what is simulated."""

    smallest_visible: float = number(
        0.08, "share", "of the light lost in the corner", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    largest_error: float = number(
        0.3, "share", "standard deviation beyond which no point moves far enough over the frame"
    )
    least_error: float = number(0.01, "share", "what the law itself leaves uncertain")
    largest_loss: float = number(0.8, "share", "of the light in the corner that is simulated at most")
    least_passed: float = number(
        0.1,
        "share",
        "of the light that the simulated lens passes at least: the inverse of less would be noise",
        NOT_RECORDED,
        "no data: a guard",
    )


SETTINGS = VignettingSettings()


class Vignetting(Effect):
    """light -> (1 - v r^2) light, v [3], r = distance from the middle over half the photo's diagonal.

    The middle passes everything: a common factor cannot be distinguished from a brighter scene. The frame's margin
    counts as the photo's border.
    """

    name = "vignetting"
    physics = "Light that comes in aslant is cut off by the lens barrel and spread over more of the sensor (cos^4)."
    place = "sensor"

    def __init__(self, strength: Tensor) -> None:
        super().__init__({"strength": strength})

    def _passed(self, shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
        r2 = radius2(shot, like)
        strength = self.parameters["strength"].to(like)[:, None, None]
        return (1 - strength * r2).clamp(min=SETTINGS.least_passed), r2

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return self._passed(shot, light)[0] * light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, r2 = self._passed(shot, light)
        inside = passed > SETTINGS.least_passed
        self._add("strength", -(upstream * light * r2 * inside).sum(dim=(1, 2)))
        return passed * upstream

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return light / self._passed(shot, light)[0]


def inspect(photos: PhotoSet) -> Evidence:
    """Loss in the corners, relative to the middle."""
    import numpy as np  # late: the command line's help reads this file

    smallest = SETTINGS.smallest_visible
    fit = photos.photometry
    if fit is None:
        return unknown("vignetting", "share", smallest, f"Not measured: {photos.no_observations}")
    value, error = float(fit.vignette.mean()), float(fit.vignette_draws.mean(axis=1).std())
    if error > SETTINGS.largest_error:
        return unknown("vignetting", "share", smallest, "Not measured: no point moves far enough over the frame")
    text = f"A point that moves from the middle to a corner loses {100 * value:.1f} +- {100 * error:.1f} % of its light"
    return judged("vignetting", value, float(np.hypot(error, SETTINGS.least_error)), smallest, "share", text)


def build(photos: PhotoSet) -> Vignetting | None:
    """The loss of the points' fit; one glass for all channels: their mean is three times as certain as each of them."""
    import numpy as np  # late: the command line's help reads this file
    import torch  # heavy

    fit = photos.photometry
    if fit is None:
        return None
    return Vignetting(torch.full((3,), float(np.clip(fit.vignette.mean(), 0.0, SETTINGS.largest_loss))))


SPEC = EffectSpec(
    name="vignetting",
    physics=Vignetting.physics,
    words=EffectWords(
        label="Vignetting",
        tooltip="A lens that passes less light towards the corners",
        simulated="Vignetting, undone on the photos before the training.",
        missing="Vignetting: the lens's loss of light towards the corners",
    ),
    inspect=inspect,
    switch=Switch(speakers=("vignetting",), trial_rank=2, simulation=Vignetting, build=build),
)
