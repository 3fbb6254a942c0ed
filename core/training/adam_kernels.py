"""Adam (Kingma and Ba 2015) over one parameter array, fused into one pass over memory."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel

f32 = np.float32
#: Values per parallel item.
BLOCK = 16384


@kernel
def adam_step(begin, end, values, gradient, first, second, rate, tail_rate, head, period, beta1, beta2, correction,
              epsilon, refused):  # type: ignore[no-untyped-def]  # fmt: skip
    """Updates blocks `begin` to `end` of flat arrays in place.

    Args:
        values, gradient, first, second: [n] float32; `first`, `second` are the moments.
        rate, tail_rate: step sizes of the first `head` of every `period` values and of the others,
            already divided by the first moment's bias correction.
        correction: 1 / sqrt of the second moment's bias correction.
        refused: [blocks] int64 output, non-finite gradient entries; they move nothing.
    """
    for block in range(begin, end):
        bad = 0
        for i in range(block * BLOCK, min((block + 1) * BLOCK, values.shape[0])):
            g = gradient[i]
            if not abs(g) <= f32(1e18):
                bad += 1
                g = f32(0)
            m = beta1 * first[i] + (f32(1) - beta1) * g
            v = beta2 * second[i] + (f32(1) - beta2) * g * g
            first[i] = m
            second[i] = v
            step = rate if i % period < head else tail_rate
            values[i] -= step * m / (f32(math.sqrt(v)) * correction + epsilon)
        refused[block] = bad
