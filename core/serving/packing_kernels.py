"""A rendered frame as rows of pixels for a program that draws them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import kernel
from ..forward.collecting_kernels import decoded

f32 = np.float32
#: Where nothing is seen there is no depth: what renderers write there.
NOWHERE = f32(1e10)
#: Less alpha than a 16-bit step has no colour and no depth worth a division.
LEAST_ALPHA = f32(1.0 / 65535.0)


@kernel
def pack(
    begin: int,
    end: int,
    image: Any,
    alpha: Any,
    depth: Any,
    margin: int,
    table: Any,
    light: bool,
    power: Any,
    opaque: bool,
    unit: Any,
    solid: Any,
    pixels: Any,
    depths: Any,
) -> None:
    """Rows `begin` to `end` of the picture, which run upwards.

    Args:
        image: [3, H + 2m, W + 2m] sRGB over the background, or over black where there is none; alpha: of the same size.
        depth: blended depths of the same size, or [0, 0].
        table: of `collecting_kernels.decoded`.
        light: whether linear light is wanted; power: of the curve that leads to it, 0 for sRGB's own.
        opaque: whether there is a background.
        unit: the scene's units per unit of depth.
        solid: alpha from which on there is a depth.
        pixels: [H, W, 4] output, colours multiplied by alpha; depths: [H, W] output, or [0, 0].
    """
    height, width = pixels.shape[0], pixels.shape[1]
    for row in range(begin, end):
        y = height - 1 - row + margin
        for x in range(width):
            a = alpha[y, x + margin]
            for c in range(3):
                value = image[c, y, x + margin]
                if light and (opaque or a > LEAST_ALPHA):
                    over = f32(1.0) if opaque else a
                    value = max(value / over, f32(0.0))
                    value = (decoded(value, table) if power == f32(0.0) else value**power) * over
                pixels[row, x, c] = value
            pixels[row, x, 3] = f32(1.0) if opaque else a
            if depths.shape[0] > 0:
                depths[row, x] = depth[y, x + margin] / a * unit if a > max(solid, LEAST_ALPHA) else NOWHERE
