"""Exposure and white balance of every photo: a gain and an offset for each channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.effect import Effect, Shot, index_of
from ..inspection.evidence import Evidence, judged, unknown
from ..inspection.scatter import scatter_of
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class ExposureSettings:
    """Numbers of the evidence for exposure, and of what is simulated."""

    smallest_visible: float = number(
        0.03,
        "relative",
        "standard deviation of the natural log of the gain that a twin begins to show (flicker between views)",
        SMALLEST_CHOSEN,
        SMALLEST_CHECKED,
    )
    largest_error: float = number(
        0.1, "relative", "a channel's gain that is less certain than this (natural log) is not taken"
    )


SETTINGS = ExposureSettings()


class Exposure(Effect):
    """light -> exp(g) light + o, with g and o [V, 3] of V photos.

    A common factor of all photos cannot be distinguished from a brighter scene: mean gain 1 (mean g 0) and mean offset
    0 over the photos are the convention. Photos that are not named pass unchanged.
    """

    name = "exposure"
    physics = "Shutter, aperture, sensitivity and white balance multiply the light of each photo by factors of its own."
    place = "sensor"

    def __init__(self, names: Sequence[str], log_gains: Tensor, offsets: Tensor | None = None) -> None:
        zero = log_gains.new_zeros(log_gains.shape)
        super().__init__({"log_gains": log_gains, "offsets": zero if offsets is None else offsets})
        self.names = tuple(names)

    def _of(self, shot: Shot) -> tuple[int, Tensor, Tensor] | None:
        index = index_of(self.names, shot.name)
        if index is None:
            return None
        gain = self.parameters["log_gains"][index].exp()[:, None, None]
        return index, gain, self.parameters["offsets"][index][:, None, None]

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        return light if found is None else found[1] * light + found[2]

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        if found is None:
            return upstream
        index, gain, _ = found
        for name, value in (("log_gains", upstream * gain * light), ("offsets", upstream)):
            like = self.parameters[name]
            whole = like.new_zeros(like.shape)
            whole[index] = value.sum(dim=(1, 2))
            self._add(name, whole)
        return gain * upstream

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        return light if found is None else (light - found[2]) / found[1]

    def settle(self) -> None:
        """Mean of the log gains and of the offsets 0."""
        for parameter in self.parameters.values():
            value = parameter.detach()
            value -= value.mean(dim=0, keepdim=True)

    def described(self) -> dict[str, object]:
        """Gain of each channel by photo."""
        return {
            name: [round(float(v), 4) for v in row.exp()]
            for name, row in zip(self.names, self.parameters["log_gains"].detach(), strict=True)
        }


def inspect(photos: PhotoSet) -> Evidence:
    """Spread of the photos' common gain, where they show the same points."""
    import numpy as np  # late: the command line's help reads this file

    fit = photos.photometry
    if fit is None:
        return unknown("exposure", "relative", SETTINGS.smallest_visible, f"Not measured: {photos.no_observations}")
    gains, draws = fit.gains.mean(axis=1), fit.gains_draws.mean(axis=2)
    value, error = scatter_of(gains, draws)
    text = (
        f"The same points are {100 * value:.1f} % (rms) brighter or darker from photo to photo, "
        f"{np.ptp(gains) / np.log(2):.2f} stops from the darkest to the brightest photo"
    )
    evidence = judged("exposure", value, error, SETTINGS.smallest_visible, "relative", text)
    assert photos.observations is not None
    names = photos.observations.names
    evidence.plots.update(gains={n: [float(v) for v in row] for n, row in zip(names, fit.gains, strict=True)})
    return evidence


def build(photos: PhotoSet) -> Exposure | None:
    """Gains of the points' fit."""
    import numpy as np  # late: the command line's help reads this file
    import torch  # heavy

    fit, observations = photos.photometry, photos.observations
    if fit is None or observations is None:
        return None
    certain = fit.gains_draws.std(axis=0) < SETTINGS.largest_error
    # A channel that few points measure goes with the photo's others; a photo that none measure keeps gain 1.
    others = (fit.gains * certain).sum(axis=1, keepdims=True) / np.maximum(certain.sum(axis=1, keepdims=True), 1)
    gains = np.where(certain, fit.gains, others)
    exposure = Exposure(observations.names, torch.tensor(gains, dtype=torch.float32))
    exposure.settle()
    return exposure


SPEC = EffectSpec(
    name="exposure",
    physics=Exposure.physics,
    words=EffectWords(
        label="Exposure",
        tooltip="Photos whose brightness and white balance differ",
        simulated="Exposure and white balance of every photo, undone on the photos before the training.",
        missing="Exposure and white balance that differ from photo to photo",
    ),
    inspect=inspect,
    switch=Switch(speakers=("exposure", "white_balance"), trial_rank=1, simulation=Exposure, build=build),
)
