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
    p = np.zeros(UNKNOWNS)
    j = np.zeros(UNKNOWNS)
    normal = np.zeros((UNKNOWNS, UNKNOWNS))
    damped = np.zeros((UNKNOWNS, UNKNOWNS))
    right = np.zeros(UNKNOWNS)
    step = np.zeros(UNKNOWNS)
    for n in range(begin, end):
        r0, c0 = row[n], column[n]
        fitted[n, 0] = np.nan
        p[:] = 0.0
        p[5], p[7] = direction[n], start
        # Level and height from the two sides.
        cosine, sine = math.cos(p[5]), math.sin(p[5])
        low, high, lows, highs = 0.0, 0.0, 0, 0
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if dx * dx + dy * dy > radius * radius:
                    continue
                u = dx * cosine + dy * sine
                if u > start:
                    high += grey[r0 + dy, c0 + dx]
                    highs += 1
                elif u < -start:
                    low += grey[r0 + dy, c0 + dx]
                    lows += 1
        if lows == 0 or highs == 0:
            continue
        p[0] = low / lows
        p[3] = high / highs - p[0]
        good = False
        rest, weights = 0.0, 0.0
        for _ in range(STEPS):
            normal[:] = 0.0
            right[:] = 0.0
            rest, weights = 0.0, 0.0
            cosine, sine = math.cos(p[5]), math.sin(p[5])
            for dy in range(-reach, reach + 1):
                for dx in range(-reach, reach + 1):
                    square = dx * dx + dy * dy
                    if square > radius * radius:
                        continue
                    u = dx * cosine + dy * sine
                    v = dy * cosine - dx * sine
                    z = (u - p[4] - 0.5 * p[6] * v * v) / p[7]
                    bell = p[3] * math.exp(-0.5 * z * z) / (_ROOT_2_PI * p[7])
                    share = 0.5 * (1.0 + math.erf(z / _ROOT_2))
                    left = grey[r0 + dy, c0 + dx] - (p[0] + p[1] * dx + p[2] * dy + p[3] * share)
                    j[0], j[1], j[2], j[3] = 1.0, dx, dy, share
                    j[4] = -bell
                    j[5] = bell * (v + p[6] * v * u)
                    j[6] = -0.5 * v * v * bell
                    j[7] = -bell * z
                    rest += left * left
                    weights += 1.0
                    for a in range(UNKNOWNS):
                        right[a] += j[a] * left
                        for b in range(a + 1):
                            normal[a, b] += j[a] * j[b]
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
