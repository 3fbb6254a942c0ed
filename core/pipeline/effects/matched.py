"""Scores that do not punish a photo's own brightness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...colour import linear_to_srgb, srgb_to_linear
from ...evaluation.metrics import psnr

Planes = NDArray[np.floating]


def matched_psnr(
    render: Planes, photo: Planes, mask: NDArray[np.bool_] | None = None, behind: NDArray[np.bool_] | None = None
) -> float:
    """PSNR (dB, sRGB) after one gain per channel, in linear light, has been taken from the photo itself.

    A held-out photo's exposure cannot be estimated from the other photos; what the twin is to be judged by is the rest.

    Args:
        render, photo: [3, H, W] sRGB in [0, 1].
        mask: [H, W], True where px count.
        behind: [H, W], True where the photo shows its background, which is the same whatever the exposure.
    """
    keep = np.ones(photo.shape[1:], bool) if mask is None else mask
    # Clipped px say nothing of the gain, dark ones little.
    usable = keep.copy()
    for c in range(3):  # (not `min` along the first axis, which may be the last in memory: numpy is slow there)
        usable &= (photo[c] < 0.97) & (photo[c] > 0.05) & (render[c] > 0.02)
    if behind is not None:
        usable &= ~behind
    matched = np.asarray(render, np.float64).copy()
    for c in range(3):
        if usable.sum() > 100:
            light = srgb_to_linear(matched[c])
            filed = srgb_to_linear(np.asarray(photo[c], np.float64)[usable])
            gain = float(np.exp(np.median(np.log(filed / light[usable]))))
            gained = linear_to_srgb(light * gain)
            matched[c] = gained if behind is None else np.where(behind, matched[c], gained)
    clipped = matched.clip(0.0, 1.0).transpose(1, 2, 0)
    return psnr(clipped, np.asarray(photo, np.float64).transpose(1, 2, 0), mask)
