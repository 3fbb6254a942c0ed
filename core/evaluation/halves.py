"""A photo that was held out has an exposure that nothing has learned: one half of it shows what judges the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..colour import linear_to_srgb, srgb_to_linear

Planes = NDArray[np.floating]

#: sRGB values beyond which a px may be clipped, and says nothing of a gain.
_BLACK, _WHITE = 0.01, 0.98
#: Share of a px that must show the object.
_OPAQUE = 0.95
#: Px that a half must have to say something.
_FEWEST = 50
#: Rounds of reweighting, and the residual (linear light) from which on one counts as its size, not its square.
_ROUNDS, _KNEE = 8, 0.02


def exposed_by_halves(
    render: Planes, photo: Planes, mask: NDArray[np.bool_] | None = None, present: NDArray[np.floating] | None = None
) -> Planes:
    """The render with a gain and an offset for each channel, in linear light: of every half, from the other half.

    No px is judged by a number that it had a part in. (NeRF in the Wild, Martin-Brualla et al. 2021, fits the left half
    and judges the right one; here both are judged.)

    Args:
        render, photo: [3, H, W] sRGB in [0, 1].
        mask: [H, W], True where px count.
        present: [H, W] in [0, 1], how far px show the object; what is behind it has no exposure.

    Returns:
        [3, H, W], clipped to [0, 1]; the render itself where the other half says nothing.
    """
    shown = np.asarray(render, np.float64)
    middle = photo.shape[2] // 2
    light, filed = srgb_to_linear(shown), srgb_to_linear(np.asarray(photo, np.float64))
    usable = (photo > _BLACK) & (photo < _WHITE)
    if mask is not None:
        usable = usable & mask
    if present is not None:
        usable = usable & (present > _OPAQUE)
    out = shown.copy()
    halves = slice(0, middle), slice(middle, None)
    for mine, other in (halves, halves[::-1]):
        for c in range(len(out)):
            inside = usable[c][:, other]
            if inside.sum() < _FEWEST:
                continue
            gain, offset = _line(light[c][:, other][inside], filed[c][:, other][inside])
            out[c][:, mine] = linear_to_srgb(np.maximum(gain * light[c][:, mine] + offset, 0.0))
    if present is not None:
        out = shown + present * (out - shown)
    return np.clip(out, 0.0, 1.0)


def _line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Robust gain and offset of y = gain x + offset; the offset 0 where x is all the same."""
    weight = np.ones_like(x)
    gain, offset = 1.0, 0.0
    for _ in range(_ROUNDS):
        mean_x, mean_y = float((weight * x).sum() / weight.sum()), float((weight * y).sum() / weight.sum())
        spread = float((weight * (x - mean_x) ** 2).sum())
        if spread < 1e-6 * float(weight.sum()):
            return mean_y / max(mean_x, 1e-6), 0.0
        gain = float((weight * (x - mean_x) * (y - mean_y)).sum()) / spread
        offset = mean_y - gain * mean_x
        weight = 1.0 / np.sqrt(1.0 + ((y - gain * x - offset) / _KNEE) ** 2)
    return gain, offset
