"""Exposure and white balance of every photo, where the same points in several photos show that they differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.exposure import Exposure
from ..inspection.evidence import Evidence, judged, unknown
from ..inspection.scatter import scatter_of
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
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
        simulated="Exposure and white balance of every photo, learned with the twin, which has their mean exposure.",
        missing="Exposure and white balance that differ from photo to photo",
    ),
    inspect=inspect,
    switch=Switch(speakers=("exposure", "white_balance"), trial_rank=1, simulation=Exposure, build=build),
)
