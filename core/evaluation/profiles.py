"""Intensity profiles: values of a picture along a straight line, averaged over a short breadth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, spline_filter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sampler:
    """Reads one picture between its pixels by cubic splines.

    Attributes:
        coefficients: [C, H, W] spline coefficients of the picture.
    """

    coefficients: Array

    @staticmethod
    def of(image: ArrayLike) -> Sampler:
        """Of [H, W, 3] or [H, W] values."""
        values = np.asarray(image, np.float64)
        planes = values[None] if values.ndim == 2 else values.transpose(2, 0, 1)
        return Sampler(np.stack([spline_filter(plane, 3, mode="mirror") for plane in planes]))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in px."""
        return self.coefficients.shape[2], self.coefficients.shape[1]

    def at(self, places: ArrayLike) -> Array:
        """[..., C] values at [..., 2] places (x, y) in px; pixel centres lie at +0.5."""
        points = np.asarray(places, np.float64)
        x, y = points.reshape(-1, 2).T
        read = [
            map_coordinates(plane, [y - 0.5, x - 0.5], order=3, mode="mirror", prefilter=False)
            for plane in self.coefficients
        ]
        return np.stack(read, -1).reshape(*points.shape[:-1], len(read))

    def covers(self, places: ArrayLike) -> bool:
        """Whether all [..., 2] places lie on the picture."""
        points = np.asarray(places, np.float64)
        return bool(((points >= 0) & (points <= np.array(self.size))).all())


def intensity_profile(
    sampler: Sampler, start: ArrayLike, end: ArrayLike, step: float = 0.5, breadth: float = 0.0
) -> tuple[Array, Array]:
    """Values along the straight line from `start` to `end`.

    Args:
        sampler: of the picture.
        start, end: [2] places (x, y) in px.
        step: px between samples.
        breadth: px across the line that are averaged (as many parallel profiles, 1 px apart).

    Returns:
        [n] distances from `start` in px, and [n, C] values.
    """
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(b - a))
    if length == 0.0:
        raise ValueError("a profile needs two different places")
    along = (b - a) / length
    beside = np.array([-along[1], along[0]])
    distances = np.arange(0.0, length + 1e-9, step)
    count = max(1, round(breadth))
    offsets = np.arange(count) - (count - 1) / 2
    places = a + distances[None, :, None] * along + offsets[:, None, None] * beside
    return distances, sampler.at(places).mean(axis=0)
