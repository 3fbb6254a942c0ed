"""Noise: what is left in the flattest blocks, dark and bright ones apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class NoiseSettings:
    """Numbers of the evidence for noise."""

    smallest_visible: float = number(
        1.5, "8-bit steps", "standard deviation in steps of an 8-bit file", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    darkest: float = number(0.02, "share of full scale", "blocks with a lower mean are clipped at black")
    brightest: float = number(0.97, "share of full scale", "blocks with a higher mean are clipped at white")
    fewest_blocks: int = number(12, "count", "blocks of a photo at least, of its three channels together")
    error_share: float = number(0.08, "share", "of the estimate: its error at least")


SETTINGS = NoiseSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """Noise of the channels, and how it grows with brightness."""
    import numpy as np  # late: the command line's help reads this file

    from ..inspection import noise_level  # heavy: scipy

    smallest, level = SETTINGS.smallest_visible, noise_level.SETTINGS
    levels, rows = [], []
    for photo in photos.looked_at:
        top = float(np.iinfo(photo.pixels.dtype).max)
        parts = [noise_level.block_noise(photo.pixels[:, :, c] / top) for c in range(3)]
        rms, mean = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        usable = (mean > SETTINGS.darkest) & (mean < SETTINGS.brightest)
        if usable.sum() < SETTINGS.fewest_blocks:
            continue
        levels.append(float(np.quantile(rms[usable], level.quiet)) / level.quiet_bias)
        halves = np.median(mean[usable])
        rows.append(
            [
                float(np.quantile(rms[usable & part], level.quiet)) / level.quiet_bias
                for part in (mean < halves, mean >= halves)
            ]
        )
    if not levels:
        return unknown("noise", "8-bit steps", smallest, "Not measured: nearly everything is black or clipped")
    steps = 255.0 * np.array(levels)
    value = float(max(np.median(steps), 255.0 * photos.rounding))
    error = float(1.4826 * np.median(np.abs(steps - np.median(steps))) / np.sqrt(len(steps)))
    dark, bright = 255.0 * np.median(np.array(rows), axis=0)
    text = f"The quietest blocks vary by {value:.2f} steps of 255 (dark halves {dark:.2f}, bright halves {bright:.2f})"
    return judged(
        "noise",
        value,
        max(error, SETTINGS.error_share * value),
        smallest,
        "8-bit steps",
        text,
        dark=round(float(dark), 3),
        bright=round(float(bright), 3),
    )


SPEC = EffectSpec(
    name="noise",
    physics="Photons arrive by chance, and the camera's electronics add noise of their own.",
    words=EffectWords(
        label="Noise", missing="Noise of the camera beyond the rounding of the files, and clipped highlights"
    ),
    inspect=inspect,
)
