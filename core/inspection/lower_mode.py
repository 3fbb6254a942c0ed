"""The blur that the sharpest of many edges share: the lower mode of their widths.

Edges of soft things (shadows, round bodies, what is out of focus) are wider than the medium's blur, none is narrower
but by chance. So the histogram of widths has its lower mode at the medium's blur. The log widths are described by

    p N(mu, t^2 + e_i^2)  +  q uniform above mu, for half an octave or so  +  the rest, anywhere,

e_i each width's own error. Where a single broad hump describes them as well there is no mode, and no answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ..numbers import number
from .edges import CALIBRATION, CHECKED, Edges

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LowerModeSettings:
    """Numbers of the mixture that describes edge widths."""

    mode_spreads: tuple[float, ...] = number(
        (0.008, 0.015, 0.03, 0.05), "log width", "spreads within the mode that are tried", CALIBRATION, CHECKED
    )
    prior_shares: tuple[float, ...] = number(
        (0.5, 0.45, 0.05), "share", "of the mode, soft edges and strays to begin with; the fit moves them"
    )
    soft_gain: float = number(
        3.0, "log likelihood", "that soft edges must add to be believed in: else chance widths pass for soft ones"
    )
    soft_reach: float = number(0.5, "log width", "how far soft edges reach above the mode", CALIBRATION, CHECKED)
    stray_reach: float = number(0.7, "log width", "how far strays lie to either side of the guess")
    minimum_hump: float = number(
        0.09, "log width", "least spread of a broad hump, which is no mode", CALIBRATION, CHECKED
    )
    stray_share: float = number(0.05, "share", "of strays that is expected")
    stray_belief: float = number(20.0, "edges", "that the expected share of strays counts for")


SETTINGS = LowerModeSettings()
PRIOR = np.array(SETTINGS.prior_shares)


@dataclass(frozen=True)
class LowerMode:
    """The lower mode.

    Attributes:
        covariance: [3] xx, yy, xy, px^2 (the pixel's averaging included); error: of half the trace's root, relative.
        number: edges in the mode; share: of all.
        gain: log likelihood over that of a broad hump without a mode.
        spread: of log widths in the mode beyond their own errors.
    """

    covariance: Array = field(repr=False)
    error: float
    number: float
    share: float
    gain: float
    spread: float

    @property
    def variance(self) -> float:
        """Mean over both axes, px^2."""
        return float(self.covariance[0] + self.covariance[1]) / 2


def find_lower_mode(edges: Edges, guess: Array) -> LowerMode | None:
    """The lower mode, sought around the shape of `guess` [3] and around a round one; None with too few edges."""
    good = edges.variance > 0.05
    if good.sum() < 8:
        return None
    c, s = np.cos(edges.direction[good]), np.sin(edges.direction[good])
    basis = np.stack([c * c, s * s, 2 * c * s], axis=1)
    variance, error = edges.variance[good], edges.error[good]
    group = edges.group[good]
    mean = float(guess[:2].mean())
    best = None
    for shape in (np.array([mean, mean, 0.0]), guess):
        found = _around(shape, basis, variance, error, group)
        if best is None or found[0] > best[0] + 2.0:
            best = found
    return None if best is None else best[1]


def _around(
    shape: Array, basis: Array, variance: Array, error: Array, group: NDArray[np.int64]
) -> tuple[float, LowerMode]:
    e = np.minimum(error / (2 * variance), 0.5)
    across = np.maximum(basis @ shape, 1e-3)
    y = 0.5 * np.log(variance / across)
    state = _sought(y, e)
    for _ in range(4):
        mode, spread, shares, belongs = _polished(y, e, *state)
        if belongs.sum() < 3:
            break
        weight = belongs / (np.square(e) + spread**2) / np.square(2 * variance)
        # The mode's shape, held towards round by as much as a few edges would.
        size = float(shape[:2].mean()) * math.exp(2 * mode)
        hold = 6.0 * np.average(weight, weights=belongs)
        normal = basis.T @ (weight[:, None] * basis) + hold * np.diag([0.5, 0.5, 2.0])
        target = basis.T @ (weight * variance) + hold * np.array([0.5, 0.5, 0.0]) * size
        fitted = np.linalg.solve(normal, target)
        if fitted[0] <= 0 or fitted[1] <= 0 or fitted[2] ** 2 >= 0.9 * fitted[0] * fitted[1]:
            break
        shape = fitted / fitted[:2].mean() * size
        across = np.maximum(basis @ shape, 1e-3)
        y = 0.5 * np.log(variance / across)
        state = (0.0, spread, shares)
    mode, spread, shares, belongs = _polished(y, e, *state)
    weight = belongs / (np.square(e) + spread**2)
    total = max(float(weight.sum()), 1e-9)
    # Edges of one contour say much the same: errors add up within a group before they are squared.
    sums = np.bincount(group, weight * (y - mode))
    scatter = math.sqrt(float(np.square(sums).sum())) / total
    level = _level(_parts(y, np.hypot(e, spread), np.array(mode)), shares)
    found = LowerMode(
        shape * math.exp(2 * mode),
        max(scatter, 1 / math.sqrt(total)),
        float(belongs.sum()),
        float(shares[0]),
        level - _hump(y, e),
        spread,
    )
    return level, found


def _sought(y: Array, e: Array) -> tuple[float, float, Array]:
    """Mode, spread and shares of the likeliest mode, on a grid."""
    few = slice(None, None, max(1, len(y) // 300))
    y, e = y[few], e[few]
    grid = np.arange(-0.45, 0.45, 0.015)
    best = (-np.inf, 0.0, SETTINGS.mode_spreads[0], PRIOR)
    for spread in SETTINGS.mode_spreads:
        parts = _parts(y[None], np.hypot(e, spread)[None], grid[:, None])
        shares = np.tile(PRIOR, (len(grid), 1))
        for _ in range(10):
            mix = shares.T[:, :, None] * parts
            mix /= mix.sum(axis=0)
            shares = _shares(mix.sum(axis=2).T)
        for i in range(len(grid)):
            level = _level(parts[:, i], shares[i])
            if level > best[0]:
                best = (level, float(grid[i]), spread, shares[i])
    return best[1:]


def _polished(y: Array, e: Array, mode: float, spread: float, shares: Array) -> tuple[float, float, Array, Array]:
    """Mode, spread, shares, and [N] membership in the mode, from a start near them.

    Soft edges are believed in only where they explain the widths clearly better than none: else chance widths above
    the mode would pass for soft ones, and those below would draw it down.
    """
    tried = []
    for soft in (True, False):
        m, s, p = mode, spread, shares if soft else np.array([0.95, 0.0, 0.05])
        for _ in range(15):
            mix = p[:, None] * _parts(y, np.hypot(e, s), np.array(m))
            mix /= mix.sum(axis=0)
            p = _shares(mix.sum(axis=1), soft)
            weight = mix[0] / (e**2 + s**2)
            m += float((weight * (y - m)).sum() / max(weight.sum(), 1e-9))
        levels = [_level(_parts(y, np.hypot(e, t), np.array(m)), p) for t in SETTINGS.mode_spreads]
        s = SETTINGS.mode_spreads[int(np.argmax(levels))]
        tried.append((max(levels), (m, s, p, mix[0])))
    return tried[0][1] if tried[0][0] > tried[1][0] + SETTINGS.soft_gain else tried[1][1]


def _shares(count: Array, soft: bool = True) -> Array:
    count = count + SETTINGS.stray_belief * np.array([0.1, 0.1 if soft else 0.0, SETTINGS.stray_share])
    return count / count.sum(axis=-1, keepdims=True)


def _level(parts: Array, shares: Array) -> float:
    believed = SETTINGS.stray_belief * (
        SETTINGS.stray_share * math.log(shares[2]) + (1 - SETTINGS.stray_share) * math.log(1 - shares[2])
    )
    return float(np.log(shares @ parts).sum()) + believed


def _parts(y: Array, sd: Array, mode: Array) -> Array:
    """Densities [3, ...] of the mode, of soft edges and of strays."""
    z = (y - mode) / sd
    bell = np.exp(-0.5 * z * z) / (sd * math.sqrt(2 * math.pi))
    soft = (ndtr(z) - ndtr(z - SETTINGS.soft_reach / sd)) / SETTINGS.soft_reach
    return np.stack(
        [
            bell,
            soft,
            np.broadcast_to(np.where(np.abs(y) < SETTINGS.stray_reach, 0.5 / SETTINGS.stray_reach, 0.02), bell.shape),
        ]
    )


def _hump(y: Array, e: Array) -> float:
    """Log likelihood of one broad hump and strays."""
    best = -np.inf
    stray = np.where(np.abs(y) < SETTINGS.stray_reach, 0.5 / SETTINGS.stray_reach, 0.02)
    for broad in (SETTINGS.minimum_hump, 0.13, 0.2, 0.3):
        sd = np.sqrt(e**2 + broad**2)
        middle, share = float(np.median(y)), 0.9
        for _ in range(25):
            bell = np.exp(-0.5 * ((y - middle) / sd) ** 2) / (sd * math.sqrt(2 * math.pi))
            mine = share * bell / (share * bell + (1 - share) * stray)
            share = float(
                (mine.sum() + SETTINGS.stray_belief * (1 - SETTINGS.stray_share)) / (len(y) + SETTINGS.stray_belief)
            )
            middle = float((mine / sd**2 * y).sum() / (mine / sd**2).sum())
        level = _level(np.stack([bell, np.zeros_like(bell), stray]), np.array([share, 0.0, 1 - share]))
        best = max(best, level)
    return best
