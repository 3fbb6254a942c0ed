"""Compiled fits of one blurred step each to small round pieces of a picture."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel

#: Numbers that describe a piece: level, slope along x and y, height, place, direction, curvature, width.
UNKNOWNS = 8
#: Gauss-Newton steps at most, and the relative change of the width below which no further one is made.
STEPS, ENOUGH = 12, 2e-4
_ROOT_2 = math.sqrt(2.0)
_ROOT_2_PI = math.sqrt(2.0 * math.pi)


@inlined
def _solved(a, b, x):  # type: ignore[no-untyped-def]
    """x of a x = b by Cholesky, a [N, N] overwritten; whether it could be."""
    n = UNKNOWNS
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i == j:
                if not total > 1e-14:
                    return False
                a[i, i] = math.sqrt(total)
            else:
                a[i, j] = total / a[j, j]
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= a[i, k] * x[k]
        x[i] = total / a[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= a[k, i] * x[k]
        x[i] = total / a[i, i]
    return True


@kernel
def fit_steps(begin, end, grey, row, column, direction, start, radius, fitted):  # type: ignore[no-untyped-def]
    """Fits a + bx x + by y + c Phi((u - t - k v^2 / 2) / w) by least squares, u along the step's normal, v along it.

    Args:
        begin, end: range of pieces.
        grey: [H, W] float32.
        row, column: [N] int64, middles; no piece may reach over the border.
        direction: [N] float64, radians from x towards y: where the values rise.
        start: width to begin with, px.
        radius: of the pieces, px.
        fitted: [N, 9] float64, written: width, height, place, direction, curvature, rms of what is left, standard
            deviation of the width if that rms were 1, slope across and along the step; width NaN without a fit.
    """
    reach = int(math.floor(radius))
    most = (2 * reach + 1) ** 2
    # Row buffers, one value for each px of the piece: sums over them run in vector registers.
    right_of, below, left = np.empty(most), np.empty(most), np.empty(most)
    z, v, bell, share = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    j = np.ones((UNKNOWNS, most))
    count = 0
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dx * dx + dy * dy <= radius * radius:
                right_of[count], below[count] = dx, dy
                count += 1
    j[1], j[2] = right_of, below
    seen = np.empty(most)
    p = np.zeros(UNKNOWNS)
    normal = np.zeros((UNKNOWNS, UNKNOWNS))
    damped = np.zeros((UNKNOWNS, UNKNOWNS))
    right = np.zeros(UNKNOWNS)
    step = np.zeros(UNKNOWNS)
    weights = float(count)
    for n in range(begin, end):
        r0, c0 = row[n], column[n]
        fitted[n, 0] = np.nan
        p[:] = 0.0
        p[5], p[7] = direction[n], start
        # Level and height from the two sides.
        cosine, sine = math.cos(p[5]), math.sin(p[5])
        low, high, lows, highs = 0.0, 0.0, 0, 0
        for m in range(count):
            seen[m] = grey[r0 + int(below[m]), c0 + int(right_of[m])]
            u = right_of[m] * cosine + below[m] * sine
            if u > start:
                high += seen[m]
                highs += 1
            elif u < -start:
                low += seen[m]
                lows += 1
        if lows == 0 or highs == 0:
            continue
        p[0] = low / lows
        p[3] = high / highs - p[0]
        good = False
        rest = 0.0
        for _ in range(STEPS):
            cosine, sine = math.cos(p[5]), math.sin(p[5])
            for m in range(count):
                u = right_of[m] * cosine + below[m] * sine
                v[m] = below[m] * cosine - right_of[m] * sine
                z[m] = (u - p[4] - 0.5 * p[6] * v[m] * v[m]) / p[7]
                j[5, m] = v[m] * (1.0 + p[6] * u)
            for m in range(count):
                bell[m] = math.exp(-0.5 * z[m] * z[m])
                share[m] = math.erf(z[m] / _ROOT_2)
            size = p[3] / (_ROOT_2_PI * p[7])
            for m in range(count):
                bell[m] *= size
                j[3, m] = 0.5 * (1.0 + share[m])
                left[m] = seen[m] - (p[0] + p[1] * right_of[m] + p[2] * below[m] + p[3] * j[3, m])
                j[4, m] = -bell[m]
                j[5, m] *= bell[m]
                j[6, m] = -0.5 * v[m] * v[m] * bell[m]
                j[7, m] = -bell[m] * z[m]
            rest = 0.0
            for m in range(count):
                rest += left[m] * left[m]
            for a in range(UNKNOWNS):
                total = 0.0
                for m in range(count):
                    total += j[a, m] * left[m]
                right[a] = total
                for b in range(a + 1):
                    total = 0.0
                    for m in range(count):
                        total += j[a, m] * j[b, m]
                    normal[a, b] = total
            for a in range(UNKNOWNS):
                for b in range(a + 1):
                    damped[a, b] = normal[a, b]
                damped[a, a] *= 1.0 + 1e-4
                damped[a, a] += 1e-12
            if not _solved(damped, right, step):
                break
            # A step of the width beyond a third of it, or of the place beyond a width, leaves where the model is one.
            shrink = 1.0
            shrink = min(shrink, 0.35 * p[7] / (abs(step[7]) + 1e-12))
            shrink = min(shrink, 0.7 * p[7] / (abs(step[4]) + 1e-12))
            shrink = min(shrink, 0.3 / (abs(step[5]) + 1e-12))
            for a in range(UNKNOWNS):
                p[a] += shrink * step[a]
            if not (0.15 * start < p[7] < 6.0 * start) or abs(p[4]) > radius:
                break
            if abs(step[7]) < ENOUGH * p[7]:
                good = True
                break
        if not good or weights <= UNKNOWNS:
            continue
        for a in range(UNKNOWNS):
            for b in range(a + 1):
                damped[a, b] = normal[a, b]
            damped[a, a] += 1e-14
            right[a] = 0.0
        right[7] = 1.0
        if not _solved(damped, right, step) or step[7] <= 0.0:
            continue
        fitted[n, 0] = p[7]
        fitted[n, 1] = p[3]
        fitted[n, 2] = p[4]
        fitted[n, 3] = p[5]
        fitted[n, 4] = p[6]
        fitted[n, 5] = math.sqrt(rest / (weights - UNKNOWNS))
        fitted[n, 6] = math.sqrt(step[7])
        fitted[n, 7] = p[1] * math.cos(p[5]) + p[2] * math.sin(p[5])
        fitted[n, 8] = p[2] * math.cos(p[5]) - p[1] * math.sin(p[5])
