"""How well a photo determines its kernel: standard errors of its weights and of its variance.

The kernel w is the least of F (`training.optics.kernels`), a parabola within w >= 0. Its curvature alone would be the
posterior of independent px (Laplace), but what a twin leaves of a photo is alike in neighbours. So the photo is cut
into tiles, and the slopes s_t of F in each tell how they really scatter (the sandwich: Liang & Zeger 1986, Longitudinal
data analysis using generalized linear models, equation 9). As weights cannot be negative, F is found anew with those
slopes times random numbers z_t of the normal distribution added,

    w_d = argmin F(w) - w . sum over t of z_t s_t,

and the errors are the spread of the w_d. To the variance's error is added what the price of width takes from it, and
how far the kernel still is from the best one on the finished twin. That the twin itself is softer than the scene, or
that all photos share a width, is not in it: no photo shows that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numbers import number
from .kernel_weights import LearnedKernelsSettings, best_weights, places_of_weights

Array = NDArray[np.float64]

_MADE_UP = "40 kernels of four forms on made-up light: 4, 6 and 8 tiles cover the truth alike"


@dataclass(frozen=True)
class KernelErrorSettings:
    """Numbers of the kernels' errors."""

    tiles: int = number(6, "count", "along each side of a photo, in which slopes are added up", _MADE_UP)
    draws: int = number(24, "count", "kernels that are found anew: their spread is known to a seventh", "not varied")


SETTINGS = KernelErrorSettings()


@dataclass(frozen=True)
class KernelErrors:
    """Of one kernel.

    Attributes:
        weights: [K] standard errors; variance: of the mean variance along both axes, squared distances of tents.
    """

    weights: Array
    variance: float


def tile_of(rows: int, columns: int, settings: KernelErrorSettings = SETTINGS) -> NDArray[np.intp]:
    """[rows, columns] which tile a px lies in."""
    down, across = (np.arange(count) * settings.tiles // count for count in (rows, columns))
    return down[:, None] * settings.tiles + across[None, :]


def errors_of(
    matrix: Array,
    vector: Array,
    slopes: Array,
    now: Array,
    asked: LearnedKernelsSettings,
    settings: KernelErrorSettings = SETTINGS,
) -> KernelErrors | None:
    """Standard errors of a kernel; None where nothing is found.

    Args:
        matrix, vector: [K, K] and [K] of F (`best_weights`); slopes: [T, K] of each tile at the least of F.
        now: [K] the weights as they are; asked: with which F is made.
    """
    best, free = best_weights(matrix, vector, asked), best_weights(matrix, vector, asked, price=0.0)
    random = np.random.default_rng(0).normal(size=(settings.draws, len(slopes)))
    found = [best_weights(matrix, vector + row @ slopes, asked) for row in random]
    drawn = np.array([weights for weights in found if weights is not None])
    if best is None or free is None or len(drawn) < 2:
        return None
    half = (places_of_weights() ** 2).sum(axis=1) / 2.0
    apart = (float((free - best) @ half), float((now - best) @ half))
    return KernelErrors(
        np.hypot(drawn.std(axis=0, ddof=1), now - best), math.hypot(float((drawn @ half).std(ddof=1)), *apart)
    )
