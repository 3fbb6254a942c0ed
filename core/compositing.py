"""What is behind an object that photos show without surroundings: one colour, and how photos are put over it.

A file's alpha says where it is empty. Whoever needs a picture needs a colour there, and wherever photos are compared
with a twin it has to be the same one behind both. All of that is here:

    over(c) = alpha colour + (1 - alpha) c                   (straight alpha, as PNG files have it)
    over(d) = over(c) + (1 - alpha) (d - c)                  (so that another colour needs no division)

Both are linear in what lies over the colour, and so are averages, interpolation and blur: a photo over a colour may be
shrunk, undistorted and averaged as it is, if its alpha is treated alike, and no rim of what a file hides under
alpha 0 appears. A blur keeps this only in the space it is linear in: where light is blurred, the px between object and
nothing are mixtures of light, so that the photo is put over its background in linear light. A sharp photo is put over
it in sRGB values, as viewers of PNG files do it and as the splats of a twin are blended.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .background import BLACK, WHITE, Background, Colour
from .colour import linear_to_srgb, srgb_to_linear

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
Planes = NDArray[np.float32]

#: Less alpha than any file can have but none: a step of 16 bits.
_LEAST_ALPHA = 1.0 / 65535.0


def under(background: Background, straight: Pixels, alpha: Pixels) -> Pixels:
    """A file's colours over the background.

    Args:
        straight: [H, W, 3] sRGB-encoded, not multiplied by alpha; alpha: [H, W] of the same dtype.

    Returns:
        [H, W, 3] of the same dtype, rounded.
    """
    top = np.float32(np.iinfo(straight.dtype).max)
    planes = blended(background, straight.transpose(2, 0, 1).astype(np.float32) / top, 1 - opacity(alpha))
    shown: Pixels = np.round(planes.clip(0.0, 1.0) * top).astype(straight.dtype).transpose(1, 2, 0).copy()
    opaque = alpha == top  # to the bit as filed
    shown[opaque] = straight[opaque]
    return shown


def blended(background: Background, straight: Planes, empty: Planes) -> Planes:
    """Colours [3, H, W] (sRGB, not multiplied by alpha) over the background; empty: [H, W], 1 - alpha."""
    behind = _decoded(background, _plane(background.colour))
    return _encoded(background, (1 - empty) * _decoded(background, straight) + empty * behind)


def unblended(background: Background, planes: Planes, empty: Planes) -> Planes:
    """What `blended` was given; black where the photo is empty."""
    share = np.maximum(1 - empty, np.float32(_LEAST_ALPHA))
    before = _decoded(background, planes) - empty * _decoded(background, _plane(background.colour))
    return np.where(empty < 1, _encoded(background, before / share), np.float32(0)).clip(0.0, 1.0)


def over_another(background: Background, planes: Planes, empty: Planes, colour: Colour | Planes) -> Planes:
    """A photo over the background, put over another colour instead.

    Args:
        planes: [3, H, W] sRGB over the background; empty: [H, W], 1 - alpha.
        colour: sRGB in [0, 1]: one, or [3, H, W] of each px.

    Returns:
        [3, H, W] float32 sRGB.
    """
    new = _decoded(background, colour if isinstance(colour, np.ndarray) else _plane(colour))
    apart = new - _decoded(background, _plane(background.colour))
    return _encoded(background, _decoded(background, planes) + empty * apart)


def transparent(over_black: Planes, over_white: Planes, space: Literal["srgb", "linear"]) -> Planes:
    """[4, H, W] colours, not multiplied by alpha, and alpha of what was seen over black and over white ([3, H, W])."""
    black, white = Background(BLACK, space), Background(WHITE, space)
    apart = _decoded(white, over_white) - _decoded(black, over_black)
    empty = np.asarray(apart.mean(axis=0).clip(0.0, 1.0), np.float32)
    return np.concatenate([unblended(black, over_black, empty), 1 - empty[None]])


def opacity(alpha: Pixels) -> Planes:
    """[H, W] alpha in [0, 1]."""
    return alpha.astype(np.float32) / np.float32(np.iinfo(alpha.dtype).max)


def _plane(colour: Colour) -> Planes:
    return np.asarray(colour, np.float32)[:, None, None]


def _decoded(background: Background, planes: Planes) -> Planes:
    return planes if background.space == "srgb" else np.asarray(srgb_to_linear(planes), np.float32)


def _encoded(background: Background, values: Planes) -> Planes:
    return values if background.space == "srgb" else np.asarray(linear_to_srgb(values), np.float32)
