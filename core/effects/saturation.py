"""Saturation: pixels at the top of their range say only that the scene was at least that bright."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..inspection.evidence import Evidence, judged
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class SaturationSettings:
    """Numbers of the evidence for clipped pixels."""

    smallest_visible: float = number(
        0.005, "share", "of the px with a clipped channel", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    least_error: float = number(0.0005, "share", "of the estimate")
    levels: int = number(255, "levels", "a channel within one of so many levels of the file's largest is clipped")


SETTINGS = SaturationSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """Share of px with a channel within one step of the file's largest value."""
    import numpy as np  # late: the command line's help reads this file

    shares = []
    for photo in photos.photos:
        top = int(np.iinfo(photo.pixels.dtype).max)
        clipped = (photo.pixels >= top - top // SETTINGS.levels).any(axis=2)
        behind = photos.behind(photo)
        if behind is not None:
            clipped &= ~behind
        masked = photo.mask is not None and photo.mask.any()
        shares.append(float(clipped[photo.mask].mean() if masked else clipped.mean()))
    value = float(np.mean(shares))
    error = float(np.std(shares) / np.sqrt(len(shares)))
    text = f"{100 * value:.2f} % of the pixels are clipped, {100 * max(shares):.1f} % in the worst photo"
    return judged("saturation", value, max(error, SETTINGS.least_error), SETTINGS.smallest_visible, "share", text)


def unclipped(photo: NDArray[Any], levels: int) -> NDArray[np.bool_]:
    """[H, W] px of a photo [H, W, 3] none of whose channels is within one of `levels` of the largest value."""
    import numpy as np  # late: the command line's help reads this file

    top = int(np.iinfo(photo.dtype).max)
    return np.asarray(~(photo >= top - top // levels).any(axis=2))


SPEC = EffectSpec(
    name="saturation",
    physics="A pixel holds so much light and no more: what is brighter is cut off at the file's largest value.",
    words=EffectWords(
        label="Clipped Highlights",
        tooltip="Pixels at the top of their range: they only say that the scene was at least that bright",
        simulated="Clipped pixels: they do not count.",
    ),
    inspect=inspect,
    switch=Switch(speakers=("saturation",), trial_rank=4, counts=unclipped),
)
