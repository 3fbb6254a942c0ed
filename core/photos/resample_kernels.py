"""Samples photos between their pixels: quintic B-splines (Thevenaz, Blu & Unser 2000)."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel


@inlined
def _weights(t, w):  # type: ignore[no-untyped-def]
    """Six weights of the quintic B-spline at offset t in [0, 1) behind the third sample."""
    s = 1.0 - t
    w[5] = t * t * t * t * t / 120.0
    w[0] = s * s * s * s * s / 120.0
    a = 1.0 + t
    w[1] = (a * (a * (a * (a * (5.0 * a - 45.0) + 150.0) - 210.0) + 75.0) + 51.0) / 120.0
    t2 = t * t
    w[2] = (66.0 + t2 * (-60.0 + t2 * (30.0 - 10.0 * t))) / 120.0
    s2 = s * s
    w[3] = (66.0 + s2 * (-60.0 + s2 * (30.0 - 10.0 * s))) / 120.0
    b = 1.0 + s
    w[4] = (b * (b * (b * (b * (5.0 * b - 45.0) + 150.0) - 210.0) + 75.0) + 51.0) / 120.0


@inlined
def _mirrored(i, size):  # type: ignore[no-untyped-def]
    """The sample that stands for one beyond the border."""
    i = -i if i < 0 else i
    i = 2 * (size - 1) - i if i >= size else i
    return min(max(i, 0), size - 1)


@kernel
def sample(begin, end, coefficients, at, out):  # type: ignore[no-untyped-def]
    """Rows `begin` to `end` of the output.

    coefficients: [H, W, C] float32 spline coefficients
    at: [h, w, 2] float64 px, pixel centres at +0.5; NaN or outside the frame gives 0
    out: [h, w, C] float32
    """
    height, width, channels = coefficients.shape
    wx = np.empty(6)
    wy = np.empty(6)
    us = np.empty(6, np.int64)
    for row in range(begin, end):
        for column in range(at.shape[1]):
            x, y = at[row, column, 0] - 0.5, at[row, column, 1] - 0.5
            for c in range(channels):
                out[row, column, c] = 0.0
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                continue
            ix, iy = int(np.floor(x)), int(np.floor(y))
            _weights(x - ix, wx)
            _weights(y - iy, wy)
            for j in range(6):
                us[j] = _mirrored(ix - 2 + j, width)
            if channels == 3:  # sums in registers: three times as fast
                red = green = blue = np.float32(0.0)
                for j in range(6):
                    line = coefficients[_mirrored(iy - 2 + j, height)]
                    r = g = b = np.float32(0.0)
                    for i in range(6):
                        u, weight = us[i], np.float32(wx[i])
                        r += weight * line[u, 0]
                        g += weight * line[u, 1]
                        b += weight * line[u, 2]
                    weight = np.float32(wy[j])
                    red += weight * r
                    green += weight * g
                    blue += weight * b
                out[row, column, 0], out[row, column, 1], out[row, column, 2] = red, green, blue
                continue
            for j in range(6):
                v = _mirrored(iy - 2 + j, height)
                for i in range(6):
                    weight = np.float32(wx[i] * wy[j])
                    for c in range(channels):
                        out[row, column, c] += weight * coefficients[v, us[i], c]
