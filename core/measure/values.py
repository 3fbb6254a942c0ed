"""Lengths, angles and areas of places, with intervals: the places' own spread, carried through by samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .places import SurfacePoint

Array = NDArray[np.float64]

#: Draws of each measure: a standard deviation from so many is right to 1.5 %, a 95 % interval's end to 0.05 of it.
DRAWS = 2000
#: Of a normal distribution: 95 % lie within so many standard deviations.
WITHIN = 1.959964


@dataclass(frozen=True)
class Value:
    """A measure in the scene's own units (lengths), their squares (areas) or degrees.

    Attributes:
        value: of the places as they are.
        draws: [DRAWS] the same of places that are as likely.
        pixel: size of a px there, scene's own units; 0 for angles.
        power: 1 for lengths, 2 for areas, 0 for angles.
    """

    value: float
    draws: Array = field(repr=False)
    pixel: float
    power: int


def drawn(place: SurfacePoint, generator: np.random.Generator) -> Array:
    """[DRAWS, 3] positions that a place may have."""
    return np.asarray(generator.multivariate_normal(place.position, place.covariance, DRAWS, method="eigh"))


def valued(kind: str, places: Sequence[SurfacePoint], draws: Sequence[Array]) -> Value:
    """A measure of places.

    Args:
        kind: 'length', 'polyline', 'angle' (at the second of three) or 'area' (of the polygon, seen along its normal).
        draws: [DRAWS, 3] of each place, so that measures of the same place go together.
    """
    true = np.stack([place.position for place in places])[None]
    maybe = np.stack(draws, axis=1)
    measure, power = {"angle": (_angle, 0), "area": (_area, 2)}.get(kind, (_length, 1))
    pixel = float(np.mean([place.pixel for place in places])) if power else 0.0
    return Value(float(measure(true)[0]), measure(maybe), pixel, power)


def _length(points: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1))


def _angle(points: Array) -> Array:
    a, b = points[:, 0] - points[:, 1], points[:, 2] - points[:, 1]
    across = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(across, (a * b).sum(axis=1))))


def _area(points: Array) -> Array:
    """Of a polygon: half the length of the sum of its corners' cross products."""
    from_first = points - points[:, :1]
    return np.asarray(np.linalg.norm(np.cross(from_first[:, 1:-1], from_first[:, 2:]).sum(axis=1), axis=1) / 2)
