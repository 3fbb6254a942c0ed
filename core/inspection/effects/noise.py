"""Noise: what is left in the flattest blocks, dark and bright ones apart."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..noise_level import QUIET, QUIET_BIAS, block_noise
from ..photo_set import PhotoSet

#: Standard deviation in steps of an 8-bit file.
SMALLEST = 1.5


def inspect(photos: PhotoSet) -> Evidence:
    """Noise of the channels, and how it grows with brightness."""
    levels, rows = [], []
    for photo in photos.looked_at:
        top = float(np.iinfo(photo.pixels.dtype).max)
        parts = [block_noise(photo.pixels[:, :, c] / top) for c in range(3)]
        rms, mean = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        usable = (mean > 0.02) & (mean < 0.97)
        if usable.sum() < 12:
            continue
        levels.append(float(np.quantile(rms[usable], QUIET)) / QUIET_BIAS)
        halves = np.median(mean[usable])
        rows.append(
            [float(np.quantile(rms[usable & part], QUIET)) / QUIET_BIAS for part in (mean < halves, mean >= halves)]
        )
    if not levels:
        return unknown("noise", "8-bit steps", SMALLEST, "Not measured: nearly everything is black or clipped")
    steps = 255.0 * np.array(levels)
    value = float(max(np.median(steps), 255.0 * photos.rounding))
    error = float(1.4826 * np.median(np.abs(steps - np.median(steps))) / np.sqrt(len(steps)))
    dark, bright = 255.0 * np.median(np.array(rows), axis=0)
    text = f"The quietest blocks vary by {value:.2f} steps of 255 (dark halves {dark:.2f}, bright halves {bright:.2f})"
    return judged(
        "noise",
        value,
        max(error, 0.08 * value),
        SMALLEST,
        "8-bit steps",
        text,
        dark=round(float(dark), 3),
        bright=round(float(bright), 3),
    )
