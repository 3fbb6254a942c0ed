"""White balance: how the photos' colour differs where they show the same points; simulated as a part of exposure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..inspection.evidence import Evidence, judged, unknown
from ..inspection.scatter import scatter_of
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class WhiteBalanceSettings:
    """Numbers of the evidence for white balance."""

    smallest_visible: float = number(
        0.02,
        "relative",
        "standard deviation of the natural log of one channel's gain against the others'",
        SMALLEST_CHOSEN,
        SMALLEST_CHECKED,
    )


SETTINGS = WhiteBalanceSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """Spread of the channels' gains around each photo's common gain."""
    smallest = SETTINGS.smallest_visible
    fit = photos.photometry
    if fit is None:
        return unknown("white_balance", "relative", smallest, f"Not measured: {photos.no_observations}")
    tint = fit.gains - fit.gains.mean(axis=1, keepdims=True)
    draws = fit.gains_draws - fit.gains_draws.mean(axis=2, keepdims=True)
    value, error = scatter_of(tint, draws)
    text = f"The channels of the same points differ by {100 * value:.1f} % (rms) from photo to photo"
    return judged("white_balance", value, error, smallest, "relative", text)


SPEC = EffectSpec(
    name="white_balance",
    physics="The camera weighs its colour channels anew for each photo.",
    words=EffectWords(label="White Balance"),
    inspect=inspect,
)
