"""Saturation: pixels at the top of their range say only that the scene was at least that bright."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged
from ..photo_set import PhotoSet

#: Share of the px with a clipped channel.
SMALLEST = 0.005


def inspect(photos: PhotoSet) -> Evidence:
    """Share of px with a channel within one step of the file's largest value."""
    shares = []
    for photo in photos.photos:
        top = int(np.iinfo(photo.pixels.dtype).max)
        clipped = (photo.pixels >= top - top // 255).any(axis=2)
        shares.append(
            float(clipped[photo.mask].mean() if photo.mask is not None and photo.mask.any() else clipped.mean())
        )
    value = float(np.mean(shares))
    error = float(np.std(shares) / np.sqrt(len(shares)))
    text = f"{100 * value:.2f} % of the pixels are clipped, {100 * max(shares):.1f} % in the worst photo"
    return judged("saturation", value, max(error, 0.0005), SMALLEST, "share", text)
