"""Adam (Kingma and Ba 2015) over one parameter array, fused into one pass over memory."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel

f32 = np.float32
#: Gaussians per parallel item.
ROWS = 2048


@inlined
def adam_run(values, gradient, first, second, begin, end, rate, beta1, beta2, correction, epsilon):  # type: ignore[no-untyped-def]
    """Updates values `begin` to `end`; returns how many gradients were not finite."""
    v, g, m1, m2 = values[begin:end], gradient[begin:end], first[begin:end], second[begin:end]
    bad = 0
    for i in range(end - begin):
        finite = abs(g[i]) <= f32(1e18)
        slope = g[i] if finite else f32(0)
        bad += 0 if finite else 1
        mean = beta1 * m1[i] + (f32(1) - beta1) * slope
        square = beta2 * m2[i] + (f32(1) - beta2) * slope * slope
        m1[i] = mean
        m2[i] = square
        v[i] -= rate * mean / (f32(math.sqrt(square)) * correction + epsilon)
    return bad


@kernel
def adam_step(begin, end, values, gradient, first, second, rate, tail_rate, head, period, beta1, beta2, correction,
              epsilon, refused):  # type: ignore[no-untyped-def]  # fmt: skip
    """Updates blocks `begin` to `end` of flat arrays in place.

    Args:
        values, gradient, first, second: [n] float32, n a multiple of `period`; `first`, `second` are the moments.
        rate, tail_rate: step sizes of the first `head` of every `period` values and of the others,
            already divided by the first moment's bias correction.
        correction: 1 / sqrt of the second moment's bias correction.
        refused: [blocks] int64 output, non-finite gradient entries; they move nothing.
    """
    for block in range(begin, end):
        bad = 0
        first_row, last_row = block * ROWS, min((block + 1) * ROWS, values.shape[0] // period)
        if head == period:
            bad += adam_run(values, gradient, first, second, first_row * period, last_row * period, rate,
                            beta1, beta2, correction, epsilon)  # fmt: skip
        else:
            for row in range(first_row, last_row):
                o = row * period
                bad += adam_run(values, gradient, first, second, o, o + head, rate, beta1, beta2, correction, epsilon)
                bad += adam_run(values, gradient, first, second, o + head, o + period, tail_rate,
                                beta1, beta2, correction, epsilon)  # fmt: skip
        refused[block] = bad
