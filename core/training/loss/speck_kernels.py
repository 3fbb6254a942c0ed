"""The price of specks in passes over rows: `specks.speck_price` is the specification.

Fields are [3, H + 2, W + 2] with a border of zeros that no pass writes to, so that inner loops need no branches.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import kernel

f32 = np.float32


@kernel
def structure(begin, end, image, fields):  # type: ignore[no-untyped-def]
    """|right|^2, |down|^2 and right.down of rows `begin` to `end`, which do not include the last."""
    _, _, width = image.shape
    for y in range(begin, end):
        r, g, b = image[0, y], image[1, y], image[2, y]
        r2, g2, b2 = image[0, y + 1], image[1, y + 1], image[2, y + 1]
        aa, bb, cc = fields[0, y + 1], fields[1, y + 1], fields[2, y + 1]
        for x in range(width - 1):
            hr, hg, hb = r[x + 1] - r[x], g[x + 1] - g[x], b[x + 1] - b[x]
            vr, vg, vb = r2[x] - r[x], g2[x] - g[x], b2[x] - b[x]
            aa[x + 1] = hr * hr + hg * hg + hb * hb
            bb[x + 1] = vr * vr + vg * vg + vb * vb
            cc[x + 1] = hr * vr + hg * vg + hb * vb


@kernel
def binomial(begin, end, fields, means):  # type: ignore[no-untyped-def]
    """The binomial mean over 3 x 3 px, for rows `begin` to `end` of all three fields; it is its own adjoint."""
    _, height, width = means.shape
    for item in range(begin, end):
        field, y = item // (height - 2), item % (height - 2)
        above, row, below, out = fields[field, y], fields[field, y + 1], fields[field, y + 2], means[field, y + 1]
        for x in range(1, width - 1):
            corners = above[x - 1] + above[x + 1] + below[x - 1] + below[x + 1]
            sides = above[x] + below[x] + row[x - 1] + row[x + 1]
            out[x] = f32(0.0625) * corners + f32(0.125) * sides + f32(0.25) * row[x]


@kernel
def derivatives(begin, end, means, epsilon):  # type: ignore[no-untyped-def]
    """In place: derivatives of sqrt(l2 + epsilon) by the three entries of the averaged tensor."""
    _, _, width = means.shape
    for y in range(begin + 1, end + 1):
        aa, bb, cc = means[0, y], means[1, y], means[2, y]
        for x in range(1, width - 1):
            half, c = f32(0.5) * (aa[x] - bb[x]), cc[x]
            spread = f32(math.sqrt(half * half + c * c + epsilon * epsilon))
            low = f32(0.5) * (aa[x] + bb[x]) - spread
            scale = f32(0.5) / f32(math.sqrt(max(low, f32(0)) + epsilon))
            scale = scale if low > f32(0) else f32(0)
            turn = f32(0.5) * half / spread
            aa[x], bb[x], cc[x] = scale * (f32(0.5) - turn), scale * (f32(0.5) + turn), -scale * c / spread


@kernel
def differences(begin, end, image, slants, horizontal, vertical):  # type: ignore[no-untyped-def]
    """Derivatives by the differences to the right and down, of rows `begin` to `end` (not the last) of all channels."""
    _, height, width = image.shape
    for item in range(begin, end):
        channel, y = item // (height - 1), item % (height - 1)
        row, below, h, v = image[channel, y], image[channel, y + 1], horizontal[channel, y], vertical[channel, y]
        aa, bb, cc = slants[0, y + 1], slants[1, y + 1], slants[2, y + 1]
        for x in range(width - 1):
            right, down, c = row[x + 1] - row[x], below[x] - row[x], cc[x + 1]
            h[x] = f32(2) * aa[x + 1] * right + c * down
            v[x] = f32(2) * bb[x + 1] * down + c * right
