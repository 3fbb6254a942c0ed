"""Whether two trainings find the same paths of the camera.

What a training makes up, because its twin is soft or a point lies beside its place, it makes up otherwise from another
start and of other photos. What moved the camera is found again. A path blurs alike forwards and backwards, and where it
lies as a whole is its camera's matter: so paths are compared each around its own middle, either way through.
"""

from __future__ import annotations

import math
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
        0.5,
        "of what paths of different photos differ by",
        "that two trainings' paths of a photo may differ by",
        "shaken photos, ten trials of eight sets: 0.03 to 0.46 (a village shaken by 2 to 6 px 0.68: missed); others,"
        " seventeen of fifteen: 0.61 to 1.05",
        "banana, the orrery and the plant, shaken by 4 to 20 px: 0.05 to 0.09; four sharp sets 0.56 to 1.02"
        " (docs/studies/effects.md)",
    )
    fewest: int = number(
        8,
        "photos",
        "that both trainings were made of, or nothing is said",
        "five and six sharp photos of banana: 0.50 to 0.69",
    )
    shuffles: int = number(2000, "count", "orders of the photos that say what chance does: enough to tell one in fifty")


SETTINGS = FoundAgainSettings()


@dataclass(frozen=True)
class FoundAgain:
    """What two trainings agree on.

    Attributes:
        apart: how far a photo's two paths differ (rms along them; the mean of all photos), over the same of paths of
            different photos; 0: the same ones, 1: as any other photo's.
        chance: probability that photos in another order agree as well.
    """

    apart: float
    chance: float

    @property
    def confirms(self) -> bool:
        """Whether the same paths are found, of each photo its own."""
        return self.apart < SETTINGS.apart and self.chance < TRIALS.chance


def enough(photos: int) -> bool:
    """Whether so many photos that both trainings are made of say anything."""
    return photos >= SETTINGS.fewest


def found_again(first: Mapping[str, Array], second: Mapping[str, Array], seed: int = 0) -> FoundAgain | None:
    """Compares the paths that two trainings learned; None where they have too few photos in common.

    Args:
        first, second: [T, 2] px, where a path leads the middle of a photo, at the same times, by the photo's name.
        seed: of the orders that say what chance does.
    """
    names = sorted(set(first) & set(second))
    if not enough(len(names)):
        return None
    apart = _apart([first[name] for name in names], [second[name] for name in names])
    count = len(names)
    own, everyone = float(np.trace(apart)) / count, float(apart.sum())
    others = (everyone - count * own) / (count * (count - 1))
    if not 0.0 < others < math.inf:
        return None  # nothing has a path
    rows, draw = np.arange(count), np.random.default_rng(seed)
    shuffled = [apart[rows, draw.permutation(count)].mean() for _ in range(SETTINGS.shuffles)]
    return FoundAgain(own / others, float(np.mean(np.asarray(shuffled) <= own)))


def _apart(first: Sequence[Array], second: Sequence[Array]) -> Array:
    """[N, N] px, rms difference of each of N paths from each of N others, whichever way each leads."""
    a, b, back = _around_middle(first), _around_middle(second), _around_middle([way[::-1] for way in second])
    return np.sqrt(np.minimum(_squared(a, b), _squared(a, back)))


def _around_middle(ways: Sequence[Array]) -> Array:
    """[N, 2 T] of N paths [T, 2]."""
    stacked = np.stack(ways)
    return (stacked - stacked.mean(axis=1, keepdims=True)).reshape(len(stacked), -1)


def _squared(a: Array, b: Array) -> Array:
    """[N, N] px^2, mean over T of squared distances of rows."""
    return 2.0 * np.square(a[:, None] - b[None]).mean(axis=2)
