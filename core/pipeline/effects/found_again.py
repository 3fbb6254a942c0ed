"""Whether two trainings find the same paths of the camera.

What a training makes up, because its twin is soft or a point lies beside its place, it makes up otherwise from another
start and of other photos. What moved the camera is found again. A path blurs alike forwards and backwards, and where it
lies as a whole is its camera's matter: so paths are compared each around its own middle, either way through.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numbers import number
from .comparison import SETTINGS as TRIALS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FoundAgainSettings:
    """Numbers of the comparison of paths."""

    apart: float = number(
        0.6,
        "of the paths' own extent",
        "that two trainings' paths of a photo may differ by in the median: straight ones of one length in any two"
        " directions differ by 0.77",
        "between shaken photos, 0.05 to 0.48 (six sets), and sharp ones, 0.73 to 1.60 (eight sets)",
    )
    fewest: int = number(5, "photos", "of which both trainings learned a path, or nothing is said")
    shuffles: int = number(2000, "count", "orders of the photos that say what chance does: enough to tell one in fifty")


SETTINGS = FoundAgainSettings()


@dataclass(frozen=True)
class FoundAgain:
    """What two trainings agree on.

    Attributes:
        apart: how far a photo's two paths differ, rms, over their own extent; the median of all photos.
        chance: probability that paths of different photos agree as well.
    """

    apart: float
    chance: float

    @property
    def confirms(self) -> bool:
        """Whether the same paths are found, of each photo its own."""
        return self.apart < SETTINGS.apart and self.chance < TRIALS.chance


def found_again(first: Mapping[str, Array], second: Mapping[str, Array], seed: int = 0) -> FoundAgain | None:
    """Compares the paths that two trainings learned; None where they have too few photos in common.

    Args:
        first, second: [T, 2] px, where a path leads the middle of the photo, at the same times, by the photo's name.
        seed: of the orders that say what chance does.
    """
    names = sorted(set(first) & set(second))
    if len(names) < SETTINGS.fewest:
        return None
    apart = _apart([first[name] for name in names], [second[name] for name in names])
    own = float(np.median(np.diagonal(apart)))
    rows, draw = np.arange(len(names)), np.random.default_rng(seed)
    others = [np.median(apart[rows, draw.permutation(len(names))]) for _ in range(SETTINGS.shuffles)]
    return FoundAgain(own, float(np.mean(np.asarray(others) <= own)))


def _apart(first: Sequence[Array], second: Sequence[Array]) -> Array:
    """[N, N] how far each of N paths differs from each of N others, rms, over the mean of their extents (rms)."""
    a, b, back = _around_middle(first), _around_middle(second), _around_middle([way[::-1] for way in second])
    squared = np.minimum(_squared(a, b), _squared(a, back))
    extent = (np.sqrt(np.square(a).mean(axis=1))[:, None] + np.sqrt(np.square(b).mean(axis=1))) / 2
    # Two photos that stood still agree.
    return np.sqrt(squared) / np.maximum(extent, np.finfo(np.float64).tiny)


def _around_middle(ways: Sequence[Array]) -> Array:
    """[N, 2 T] of N paths [T, 2]."""
    stacked = np.stack(ways)
    return (stacked - stacked.mean(axis=1, keepdims=True)).reshape(len(stacked), -1)


def _squared(a: Array, b: Array) -> Array:
    """[N, N] mean squared differences of rows."""
    return np.square(a[:, None] - b[None]).mean(axis=2)
