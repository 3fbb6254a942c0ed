"""Compiled: what straight paths leave of a spectrum."""

from __future__ import annotations

import math

from ..compiled import kernel

#: Taylor's series of sin(pi r) / r in r^2, to 1e-11 within half a turn: unlike the library's sine it vectorizes.
_SINE = tuple((-1) ** k * math.pi ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(8))
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7 = _SINE
_PI2 = math.pi**2
#: Far below any square of a number that is not 0: 0 / 0 becomes 1.
_TINY = 1e-30


@kernel
def straight_shares(begin, end, along_x, along_y, fx, fy, out):  # type: ignore[no-untyped-def]
    """Mean of sinc^2 over the samples of each bin, sinc(t) = sin(pi t) / (pi t).

    Args:
        begin, end: range of paths.
        along_x, along_y: [G] float64, px from a path's begin to its end.
        fx, fy: [B, S] float64, cycles/px.
        out: [G, B] float64, written.
    """
    samples = fx.shape[1]
    for g in range(begin, end):
        x, y = along_x[g], along_y[g]
        for b in range(fx.shape[0]):
            total = 0.0
            for s in range(samples):
                t = x * fx[b, s] + y * fy[b, s]
                r = t - math.floor(t + 0.5)
                q = r * r
                sine = r * (_C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * (_C4 + q * (_C5 + q * (_C6 + q * _C7)))))))
                total += (sine * sine + _TINY) / (_PI2 * t * t + _TINY)
            out[g, b] = total / samples
