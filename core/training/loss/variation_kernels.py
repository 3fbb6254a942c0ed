"""Gradient of the joint-colour total variation, row by row."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import kernel

f32 = np.float32


@kernel
def edge_directions(begin, end, image, epsilon, knee, horizontal, vertical):  # type: ignore[no-untyped-def]
    """Differences to the right and down of rows `begin` to `end`, limited: grad / |grad| / (1 + |grad| / knee)."""
    _, height, width = image.shape
    fall = f32(1) / knee
    for y in range(begin, end):
        below = min(y + 1, height - 1)
        r, g, b = image[0, y], image[1, y], image[2, y]
        r2, g2, b2 = image[0, below], image[1, below], image[2, below]
        for x in range(width - 1):
            hr, hg, hb = r[x + 1] - r[x], g[x + 1] - g[x], b[x + 1] - b[x]
            vr, vg, vb = r2[x] - r[x], g2[x] - g[x], b2[x] - b[x]
            size = f32(math.sqrt(hr * hr + hg * hg + hb * hb + vr * vr + vg * vg + vb * vb + epsilon))
            scale = f32(1) / (size * (f32(1) + size * fall))
            horizontal[0, y, x], horizontal[1, y, x], horizontal[2, y, x] = hr * scale, hg * scale, hb * scale
            vertical[0, y, x], vertical[1, y, x], vertical[2, y, x] = vr * scale, vg * scale, vb * scale
        for c in range(3):
            horizontal[c, y, width - 1] = f32(0)
            vertical[c, y, width - 1] = f32(0)


@kernel
def negative_divergence(begin, end, horizontal, vertical, out):  # type: ignore[no-untyped-def]
    """The adjoint of the differences, for rows `begin` to `end` of all channels."""
    channels, height, width = out.shape
    for item in range(begin, end):
        c, y = item // height, item % height
        h, v, o = horizontal[c, y], vertical[c, y], out[c, y]
        above = vertical[c, max(y - 1, 0)]
        keep = f32(1) if y > 0 else f32(0)
        stay = f32(1) if y < height - 1 else f32(0)
        o[0] = -h[0] - v[0] * stay + above[0] * keep
        for x in range(1, width):
            o[x] = h[x - 1] - h[x] - v[x] * stay + above[x] * keep
