"""Width of a line or a crack across a profile.

Behind a known point spread it is what the photo says through the blur (`core.measure.line_fit`). Elsewhere, and where
the photo alone shows no line, both flanks are fitted on the sharp twin, seen by the photo's camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DgsError
from ..evaluation.edges import fit_width
from ..evaluation.profiles import Sampler, intensity_profile
from ..numbers import number
from .line_width import width_through
from .places import SurfacePoint
from .request import Point
from .sights import BlurOrigin, Sight
from .values import DRAWS, Value

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WidthSettings:
    """Of a profile."""

    stations: int = number(7, "count", "profiles beside each other, 1 px apart; the width is their median")
    step: float = number(0.4, "px", "between samples")
    minimum: int = number(3, "count", "profiles with two flanks, without which there is no line")
    shortest: float = number(6.0, "px", "that the two points are apart: fewer hold no two flanks")
    inverted: float = number(
        0.06,
        "px per px of blur",
        "standard deviation of what the inverted blur leaves too narrow or too wide: lines of 8.4 and 13.3 px come out"
        " 7.9 to 8.1 and 13.1 px through 5 px",
        "the painted lines of the rendered ball, README",
    )
    narrow: float = number(
        0.5,
        "px per px of blur",
        "the same below `blurred` times the blur, falling to `inverted` at once the blur more: black cracks of 3.9, 5.9"
        " and 9.1 px on a wall of many colours come out 6.9, 8.9 and 8.0 px through 5 px",
        "draft twin of benchmarks/cracked_wall.py",
    )
    blurred: float = number(2.0, "times the blur", "up to which a width has the standard deviation of narrow ones")
    seen_through: float = number(
        1.0, "px", "standard deviation of the blur from which on the photo is asked through it, not the twin"
    )


WIDTHS = WidthSettings()


def width_on(
    sight: Sight,
    across: tuple[Point, Point],
    ends: tuple[SurfacePoint, SurfacePoint],
    draws: Array,
    name: str,
    blur: BlurOrigin = BlurOrigin(),
) -> Value:
    """The width of what lies between two points beside a line.

    Args:
        sight: of the photo; across: the points, px of the undistorted view.
        ends: the same on the surface: they say how large a px is along the profile.
        draws: [DRAWS] of a normal distribution.
        blur: where the photos' blur acts, and comes from.

    Raises:
        DgsError: there is no line with two flanks between the points.
    """
    length = float(np.hypot(across[1][0] - across[0][0], across[1][1] - across[0][1]))
    if length < WIDTHS.shortest:
        raise DgsError(
            f"The points of '{name}' are {length:.1f} px apart: too few for two flanks", "Set them further out"
        )
    seen = width_through(sight, across, blur) if sight.blur >= WIDTHS.seen_through else None
    width, pixels = _on_twin(sight, across, name) if seen is None else seen
    pixel = float(np.linalg.norm(ends[1].position - ends[0].position)) / length
    depth = float(np.mean([sight.camera.rotation[2] @ p.position + sight.camera.translation[2] for p in ends]))
    nearer = float(np.mean([np.sqrt(np.trace(p.covariance)) for p in ends])) / depth  # a px is as large as it is far
    spread = np.hypot(pixels * pixel, width * pixel * nearer)
    assert len(draws) == DRAWS
    return Value(width * pixel, width * pixel + spread * draws, pixel, 1)


def _on_twin(sight: Sight, across: tuple[Point, Point], name: str) -> tuple[float, float]:
    """Width and its standard deviation, px, on the sharp twin."""
    start, end = np.array(across[0]), np.array(across[1])
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    beside = np.array([-along[1], along[0]])
    sampler = Sampler.of(sight.image.transpose(1, 2, 0))
    middles = sampler.at((start + end) / 2 + (np.arange(3) - 1)[:, None] * along).mean(axis=0)
    direction = middles - (sampler.at(start) + sampler.at(end)) / 2
    found = []
    for offset in np.arange(WIDTHS.stations) - (WIDTHS.stations - 1) / 2:
        moved = offset * beside
        distances, values = intensity_profile(sampler, start + moved, end + moved, WIDTHS.step)
        width = fit_width(distances - length / 2, values @ direction)
        if width is not None and 0 < width.value < length:
            found.append(width)
    if len(found) < WIDTHS.minimum:
        raise DgsError(
            f"Between the points of '{name}' there is no line with two flanks", "Set them on both sides of it"
        )
    widths = np.array([width.value for width in found])
    value = float(np.median(widths))
    scatter = 1.2533 * 1.4826 * float(np.median(np.abs(widths - value))) / np.sqrt(len(widths))
    fits = float(np.median([width.uncertainty for width in found])) / np.sqrt(len(widths))
    return value, float(np.hypot(max(scatter, fits), _left_by_blur(value, sight.blur)))


def _left_by_blur(width: float, blur: float) -> float:
    """Standard deviation (px) of what inverting the blur leaves wrong of a width."""
    if blur <= 0:
        return 0.0
    share = float(np.clip(WIDTHS.blurred + 1.0 - width / blur, 0.0, 1.0))
    return blur * (share * WIDTHS.narrow + (1.0 - share) * WIDTHS.inverted)
