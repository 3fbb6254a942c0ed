"""Distances between places against those of a print: the one size that fits them all, and how sure it is.

With d the distance of two corners in the world and D the printed one, k = sum w D d / sum w D^2 of the scene's units
are one unit of the print, w = 1 / var(d). What corners are unsure by goes through the gradient of that sum, so that
pairs which share a corner count once; what pairs disagree by beyond that widens it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from .markers import Corner
from .places import SurfacePoint

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FitSettings:
    """Of corners that are not where the print has them."""

    wrong: float = number(4.0, "standard deviations", "beyond which a corner is not where the print has it")
    misfit: float = number(0.01, "share", "of a distance that corners are off by at least before they are wrong")
    inconsistent: float = number(0.34, "share", "of corners that are wrong, from which on the print is another one")


FIT = FitSettings()


@dataclass(frozen=True)
class Group:
    """Corners whose distances are known: of one marker, or of a chessboard.

    Attributes:
        names: of n corners; places: of them; true: [n, 2] where they are on the print.
    """

    names: tuple[Corner, ...]
    places: tuple[SurfacePoint, ...]
    true: Array

    def without(self, corner: Corner) -> Group:
        """Those that are left."""
        kept = [index for index, name in enumerate(self.names) if name != corner]
        return Group(tuple(self.names[i] for i in kept), tuple(self.places[i] for i in kept), self.true[kept])


@dataclass(frozen=True)
class BoardFit:
    """What was fitted: the scene's own units for each unit of the print, and on what."""

    units: float
    deviation: float
    residual: float
    corners: tuple[Corner, ...]
    left_out: int


@dataclass(frozen=True)
class Pairs:
    """All pairs of corners of one group: indices, distances measured and true, [m] each, and [m, 3] directions."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    measured: Array
    true: Array
    ways: Array
    variances: Array

    @staticmethod
    def of(group: Group) -> Pairs:
        """The pairs, and the variances of their distances."""
        first, second = np.triu_indices(len(group.names), 1)
        at = np.stack([place.position for place in group.places])
        spread = np.stack([place.covariance for place in group.places])
        apart = at[second] - at[first]
        measured = np.linalg.norm(apart, axis=1)
        ways = apart / np.maximum(measured, 1e-12)[:, None]
        variances = np.einsum("mi,mij,mj->m", ways, spread[first] + spread[second], ways)
        true = np.linalg.norm(group.true[second] - group.true[first], axis=1)
        return Pairs(first, second, measured, true, ways, variances)


def fit_size(groups: Sequence[Group]) -> BoardFit | None:
    """The weighted fit of all distances, without corners that are not where the print has them.

    Args:
        groups: of two corners and more each, one at least.

    Returns:
        None where too many corners are wrong: this is not what was printed.
    """
    total = sum(len(group.names) for group in groups)
    left, wrong = list(groups), 0
    while True:
        worst = _worst(left, median_ratio(left))
        if worst is None:
            return _weighted(left, wrong)
        wrong += 1
        left = [smaller for group in left if len((smaller := group.without(worst)).names) > 1]
        if wrong > FIT.inconsistent * total or not left:
            return None


def median_ratio(groups: Sequence[Group]) -> float:
    """Scene units for each unit of the print: of half of the pairs it is more."""
    pairs = [Pairs.of(group) for group in groups]
    return float(np.median(np.concatenate([one.measured / one.true for one in pairs])))


def _worst(groups: Sequence[Group], units: float) -> Corner | None:
    """The corner that fits the print least, if it does not."""
    found, most = None, 1.0
    for group in groups:
        pairs = Pairs.of(group)
        sure = np.hypot(FIT.wrong * np.sqrt(pairs.variances), FIT.misfit * pairs.true * units)
        off = np.abs(pairs.measured - units * pairs.true) / sure
        for index, name in enumerate(group.names):
            score = float(np.median(off[(pairs.first == index) | (pairs.second == index)]))
            if score > most:
                found, most = name, score
    return found


def _weighted(groups: Sequence[Group], left_out: int) -> BoardFit:
    pairs = [Pairs.of(group) for group in groups]
    upper = sum(float((one.true * one.measured / one.variances).sum()) for one in pairs)
    lower = sum(float((one.true**2 / one.variances).sum()) for one in pairs)
    units, variance = upper / lower, 0.0
    for group, one in zip(groups, pairs, strict=True):
        share = (one.true / one.variances / lower)[:, None] * one.ways
        slopes = np.zeros((len(group.names), 3))
        np.add.at(slopes, one.second, share)
        np.add.at(slopes, one.first, -share)
        variance += sum(float(s @ place.covariance @ s) for s, place in zip(slopes, group.places, strict=True))
    off = np.concatenate([one.measured - units * one.true for one in pairs])
    disagreement = max(1.0, float(np.mean(off**2 / np.concatenate([one.variances for one in pairs]))))
    corners = tuple(name for group in groups for name in group.names)
    return BoardFit(
        units, float(np.sqrt(variance * disagreement)), float(np.sqrt(np.mean(off**2))) / units, corners, left_out
    )
