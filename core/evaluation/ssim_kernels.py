"""SSIM of whole pictures in float64: compiled, since windows of five fields take most of the time of scoring a view."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel


@kernel
def ssim_rows(begin, end, image, truth, keep, taps, c1, c2, sums):  # type: ignore[no-untyped-def]
    """Sum of SSIM over the px of each row that count, and over the channels.

    Args:
        image, truth: [H, W, C] float64; keep: [H, W] bool.
        taps: [R + 1] of the window, from its middle to one end, R smaller than H and W; frames are mirrored beyond
            their edges.
        c1, c2: SSIM's constants; sums: [H] output.
    """
    height, width, channels = image.shape
    reach, length = len(taps) - 1, width * channels
    room = length + 2 * reach * channels
    tall, wide = np.empty((5, room)), np.empty((5, length))
    for row in range(begin, end):
        tall[:] = 0.0
        for t in range(-reach, reach + 1):
            other = row + t
            if other < 0:
                other = -1 - other
            elif other >= height:
                other = 2 * height - 1 - other
            x, y, weight = image[other].reshape(length), truth[other].reshape(length), taps[abs(t)]
            for j in range(length):
                a, b = x[j], y[j]
                at = j + reach * channels
                tall[0, at] += weight * a
                tall[1, at] += weight * b
                tall[2, at] += weight * (a * a)
                tall[3, at] += weight * (b * b)
                tall[4, at] += weight * (a * b)
        for field in range(5):
            for t in range(reach):
                for c in range(channels):
                    left, right = (reach + t) * channels + c, (reach + width - 1 - t) * channels + c
                    tall[field, (reach - 1 - t) * channels + c] = tall[field, left]
                    tall[field, (reach + width + t) * channels + c] = tall[field, right]
            for j in range(length):
                wide[field, j] = taps[0] * tall[field, j + reach * channels]
            for t in range(1, reach + 1):
                before, after, weight = (reach - t) * channels, (reach + t) * channels, taps[t]
                for j in range(length):
                    wide[field, j] += weight * (tall[field, j + before] + tall[field, j + after])
        total = 0.0
        for column in range(width):
            if keep[row, column]:
                for j in range(column * channels, (column + 1) * channels):
                    x, y = wide[0, j], wide[1, j]
                    luminance = (2.0 * x * y + c1) / (x * x + y * y + c1)
                    spread = (wide[2, j] - x * x) + (wide[3, j] - y * y)
                    total += luminance * (2.0 * (wide[4, j] - x * y) + c2) / (spread + c2)
        sums[row] = total
