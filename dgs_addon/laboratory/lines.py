"""Lines painted on the ball, whose true widths tests can measure. Needs numpy only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .surface import BallShape


@dataclass(frozen=True)
class Line:
    """A line on the ball, in object coordinates (x along the long axis), metres.

    Attributes:
        name: how reports call it.
        kind: 'ring' runs around the long axis at x = position; 'meridian' runs from tip to tip
            at the angle `position` (radians from y towards z).
        position: metres or radians, see `kind`.
        width: metres, measured across the line in a plane tangent to the ball.
        colour: linear Rec. 709.
    """

    name: str
    kind: Literal["ring", "meridian"]
    position: float
    width: float
    colour: tuple[float, float, float]

    @property
    def direction(self) -> tuple[float, float]:
        """Cosine and sine of a meridian's angle."""
        return float(np.cos(self.position)), float(np.sin(self.position))


#: Colours of the paint, linear Rec. 709.
_WHITE = (0.80, 0.78, 0.72)
_RED = (0.55, 0.012, 0.012)

#: At 800 px width and 635 mm a millimetre on the ball's near side is about 1.8 px.
LINES = (
    Line("red", "ring", 0.006, 0.0076, _RED),
    Line("white wide", "ring", -0.044, 0.0074, _WHITE),
    Line("white thin", "ring", 0.048, 0.0047, _WHITE),
    Line("white hair", "ring", -0.076, 0.0026, _WHITE),
    Line("white meridian", "meridian", np.radians(100.0), 0.0074, _WHITE),
    Line("white thin meridian", "meridian", np.radians(178.0), 0.0047, _WHITE),
)


def centre_line(line: Line, shape: BallShape, count: int = 181) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points along the middle of the line and unit vectors across it, both [count, 3]."""
    axes = np.array([shape.half_length, shape.radius, shape.radius])
    if line.kind == "ring":
        angle = np.linspace(0.0, 2 * np.pi, count)
        ring = np.sqrt(1 - (line.position / shape.half_length) ** 2)
        points = axes * np.stack(
            [np.full(count, line.position / shape.half_length), ring * np.cos(angle), ring * np.sin(angle)], -1
        )
        along = np.stack([np.zeros(count), -np.sin(angle), np.cos(angle)], -1)
    else:
        polar = np.linspace(0.1, np.pi - 0.1, count)
        cosine, sine = line.direction
        points = axes * np.stack([np.cos(polar), np.sin(polar) * cosine, np.sin(polar) * sine], -1)
        along = axes * np.stack([-np.sin(polar), np.cos(polar) * cosine, np.cos(polar) * sine], -1)
    normal = points / axes**2
    across = np.cross(normal, along)
    return points, across / np.linalg.norm(across, axis=-1, keepdims=True)
