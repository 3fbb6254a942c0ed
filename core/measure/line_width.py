"""The width of a line through the blur of its photo (`core.measure.line_fit`), and what it is uncertain by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..colour import linear_to_srgb, srgb_to_linear
from ..numbers import BY_DEFINITION, number
from .line_fit import SETTINGS as LINE
from .line_fit import LineGuess, LineLikelihood, best_line, first_slope, fit_line, is_line
from .line_profiles import LineProfiles, line_profiles
from .line_spread import widened
from .request import Point
from .sights import BlurOrigin, Sight

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineWidthSettings:
    """Of the search, and of what the likelihood leaves out."""

    turns: int = number(2, "count", "of the profiles: roughly and exactly across the line", BY_DEFINITION)
    pixel: float = number(
        0.4,
        "share",
        "standard deviation of what a px's own adding up of light moves edges by: pixels are no squares",
        BY_DEFINITION,
    )
    estimated: float = number(
        0.04,
        "share",
        "standard deviation of a blur's width that the photos were asked for: 79 % of 28 are within 5 %. Through 5 px"
        " it moves a line of 6 px by 1.5 px and one of 14 px hardly",
        "photographs of docs/studies/blind_blur.md",
    )
    probe: float = number(0.01, "share", "that the blur is widened by, to see how far it moves the width")


SETTINGS = LineWidthSettings()


def width_through(sight: Sight, across: tuple[Point, Point], blur: BlurOrigin) -> tuple[float, float] | None:
    """Width and its standard deviation, px, by the photo.

    None where its blur is not known, it ends there, or a line says no more of it than a texture alone would.

    Args:
        across: points on both sides of the line, px of the undistorted view.
    """
    length = float(np.hypot(across[1][0] - across[0][0], across[1][1] - across[0][1]))
    found = _upright(sight, across, blur, length)
    if found is None:
        return None
    seen, likelihood, best = found
    if not is_line(likelihood, best, length):
        return None
    fit = fit_line(likelihood, best, length)
    deviations = [fit.deviation, _by_blur(seen, best, length) if blur.estimated else 0.0]
    moved = edges_moved(fit.levels) if blur.space == "srgb" else 0.0
    return fit.width + moved, float(np.linalg.norm([*deviations, SETTINGS.pixel * moved]))


def _upright(
    sight: Sight, across: tuple[Point, Point], blur: BlurOrigin, length: float
) -> tuple[LineProfiles, LineLikelihood, LineGuess] | None:
    """Profiles across the line, whichever way the points were set, and the most likely line on them."""
    seen = line_profiles(sight, across, blur.space)
    slope = 0.0 if seen is None else first_slope(seen.block, seen.spread)
    best: LineGuess | None = None
    for _ in range(SETTINGS.turns):
        seen = line_profiles(sight, across, blur.space, slope)
        if seen is None:
            return None
        likelihood = LineLikelihood(seen.places, seen.block, seen.spread)
        best = best_line(likelihood, length, best)
        slope += likelihood.slope(best)
    assert seen is not None and best is not None
    return seen, likelihood, best


def _by_blur(seen: LineProfiles, best: LineGuess, length: float) -> float:
    """Standard deviation of the width by that of an estimated blur, px."""
    wider = LineLikelihood(seen.places, seen.block, widened(seen.spread, 1.0 + SETTINGS.probe))
    moved = best_line(wider, length, best).width - best.width
    return abs(moved) * SETTINGS.estimated / SETTINGS.probe


def edges_moved(levels: Array) -> float:
    """px that a line looks narrower by in sRGB than it is: a px on its edge adds up light, not display values.

    Args:
        levels: [3, 3] sRGB before, in and behind the line.
    """
    shares = (np.arange(100) + 0.5) / 100  # of a px from outside: a square px meets an edge evenly over one px
    before, inside, behind = np.clip(levels, 0.0, 1.0)
    total = 0.0
    for outside in (before, behind):
        light = srgb_to_linear(inside) + shares[:, None] * (srgb_to_linear(outside) - srgb_to_linear(inside))
        step = outside - inside
        more = linear_to_srgb(light) - (inside + shares[:, None] * step)
        total += float((more @ step).mean()) / max(float(step @ step), LINE.noise)
    return total
