"""Adam (Kingma and Ba 2015) over one parameter array, fused into one pass over memory."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel

f32 = np.float32
#: Gaussians per parallel item.
ROWS = 2048
#: Gaussians whose step sizes stand side by side; a divisor of `ROWS`.
RUN = 64


@inlined
def adam_run(values, gradient, first, second, begin, end, rates, beta1, beta2, correction, epsilon):  # type: ignore[no-untyped-def]
    """Updates values `begin` to `end`; returns how many gradients were not finite."""
    v, g, m1, m2 = values[begin:end], gradient[begin:end], first[begin:end], second[begin:end]
    bad = np.int32(0)
    for i in range(end - begin):
        finite = abs(g[i]) <= f32(1e18)
        followed = g[i] if finite else f32(0)
        bad += np.int32(0) if finite else np.int32(1)
        mean = beta1 * m1[i] + (f32(1) - beta1) * followed
        square = beta2 * m2[i] + (f32(1) - beta2) * followed * followed
        m1[i] = mean
        m2[i] = square
        v[i] -= rates[i] * mean / (f32(math.sqrt(square)) * correction + epsilon)
    return np.int64(bad)


@kernel
def adam_step(begin, end, values, gradient, first, second, rates, period, beta1, beta2, correction, epsilon, refused):  # type: ignore[no-untyped-def]
    """Updates blocks `begin` to `end` of flat arrays in place.

    Args:
        values, gradient, first, second: [n] float32, n a multiple of `period`; `first`, `second` are the moments.
        rates: [RUN * period] step sizes, already divided by the first moment's bias correction: that of every
            value in `RUN` Gaussians, so that one loop without a branch runs through them.
        correction: 1 / sqrt of the second moment's bias correction.
        refused: [blocks] int64 output, non-finite gradient entries; they move nothing.
    """
    for block in range(begin, end):
        bad = 0
        stop = min((block + 1) * ROWS * period, values.shape[0])
        for at in range(block * ROWS * period, stop, rates.shape[0]):
            bad += adam_run(
                values,
                gradient,
                first,
                second,
                at,
                min(at + rates.shape[0], stop),
                rates,
                beta1,
                beta2,
                correction,
                epsilon,
            )
        refused[block] = bad
