"""Sub-pixel edges in one-dimensional intensity profiles, and the width of a line between two of them.

Each flank of a line is fitted by itself with the step that a Gaussian blur makes of an edge,

    I(x) = outside + (inside - outside) Phi((x - position) / blur),

(Phi: the normal distribution; ISO 12233 calls it the edge spread function). The edge lies where the
flank passes half-way between its two levels. A line narrower than its blur therefore reads WIDER than
it was painted, as under a microscope: nothing is deconvolved by the measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeWarning, least_squares
from scipy.special import ndtr

from ..numbers import BY_DEFINITION, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgeFitSettings:
    """Of the fit of one step."""

    minimum_rise: float = number(
        3.0, "standard deviations of the fit's residual", "an edge that rises by less is no edge"
    )
    steepest: float = number(
        0.15, "px", "blur of the steepest step that samples can distinguish from an infinitely steep one"
    )
    tolerance: float = number(
        1e-5,
        "relative change",
        "at which a fit stops: positions then move by less than 0.01 px, in half the time of 1e-8",
    )
    minimum_samples: int = number(8, "count", "of a profile; fewer hold no step's four parameters", BY_DEFINITION)


SETTINGS = EdgeFitSettings()


@dataclass(frozen=True)
class Edge:
    """One fitted edge.

    Attributes:
        position: where the edge lies, in the unit of the profile's positions (px).
        uncertainty: standard deviation of `position` from the fit's residual.
        blur: standard deviation of the step's Gaussian, px.
        outside, inside: the levels before and behind the edge.
    """

    position: float
    uncertainty: float
    blur: float
    outside: float
    inside: float


@dataclass(frozen=True)
class Width:
    """Width of a line in one profile.

    Attributes:
        value: distance between its two edges, px.
        uncertainty: standard deviation that both fits tell together, px.
        blur: mean blur of the two edges, px.
        middle: half-way between the edges, in the profile's positions.
    """

    value: float
    uncertainty: float
    blur: float
    middle: float = 0.0


def fit_edge(positions: ArrayLike, values: ArrayLike) -> Edge | None:
    """Fits one step; None if there is no clear edge within the samples.

    Args:
        positions: [n] px, increasing, at least 8.
        values: [n] intensities; the line's inside is at the end.
    """
    x, y = np.asarray(positions, np.float64), np.asarray(values, np.float64)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"positions and values differ in shape: {x.shape} and {y.shape}")
    if len(x) < SETTINGS.minimum_samples or not np.isfinite(y).all():
        return None
    few = max(2, len(y) // 6)
    levels = float(np.median(y[:few])), float(np.median(y[-few:]))
    if levels[0] == levels[1]:
        return None
    passed = (y - levels[0]) / (levels[1] - levels[0]) > 0.5
    start = float(x[np.argmax(passed)]) if passed.any() else float(x.mean())
    span = x[-1] - x[0]
    spread = abs(levels[1] - levels[0])

    def residual(p: Array) -> Array:
        return np.asarray(p[0] + (p[1] - p[0]) * ndtr((x - p[2]) / p[3]) - y)

    def by_unknowns(p: Array) -> Array:
        """[n, 4] derivatives of the residual."""
        z = (x - p[2]) / p[3]
        share, bell = ndtr(z), np.exp(-0.5 * z**2) * ((p[0] - p[1]) / (np.sqrt(2 * np.pi) * p[3]))
        return np.stack([1.0 - share, share, bell, bell * z], axis=1)

    # The levels are those that the profile itself reaches: a step that goes on rising beyond what was
    # sampled would move the half-way point of a narrow line outwards without limit.
    low, high = float(y.min()) - 0.02 * spread, float(y.max()) + 0.02 * spread
    try:
        fit = least_squares(
            residual,
            [np.clip(levels[0], low, high), np.clip(levels[1], low, high), start, 0.1 * span],
            bounds=([low, low, x[0], SETTINGS.steepest], [high, high, x[-1], span]),
            jac=by_unknowns,
            x_scale=[spread, spread, 1.0, 1.0],
            ftol=SETTINGS.tolerance,
            xtol=SETTINGS.tolerance,
            gtol=SETTINGS.tolerance,
        )
    except (ValueError, OptimizeWarning):
        return None
    outside, inside, position, blur = (float(value) for value in fit.x)
    noise = float(np.sqrt(2 * fit.cost / max(1, len(x) - 4)))
    if abs(inside - outside) < SETTINGS.minimum_rise * noise or (inside - outside) * (levels[1] - levels[0]) <= 0:
        return None
    # Levels may sit on their bounds; the position's own variance then is the one with fixed levels.
    curvature = fit.jac.T @ fit.jac + 1e-12 * np.eye(4)
    variance = noise**2 * float(np.linalg.inv(curvature)[2, 2])
    return Edge(position, float(np.sqrt(max(variance, 0.0))), blur, outside, inside)


def fit_width(positions: ArrayLike, values: ArrayLike, middle: float = 0.0) -> Width | None:
    """Width of a line that covers `middle`; None unless both edges are clear.

    Args:
        positions: [n] px across the line, increasing.
        values: [n] intensities.
        middle: where the line's middle is expected.
    """
    x, y = np.asarray(positions, np.float64), np.asarray(values, np.float64)
    before, after = x <= middle, x >= middle
    left = fit_edge(x[before], y[before])
    right = fit_edge(-x[after][::-1], y[after][::-1])
    if left is None or right is None:
        return None
    return Width(
        -right.position - left.position,
        float(np.hypot(left.uncertainty, right.uncertainty)),
        (left.blur + right.blur) / 2,
        (left.position - right.position) / 2,
    )
