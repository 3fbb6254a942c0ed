"""Guesses where no depth was found: between px of the same view whose depth is trusted, where no view looks through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..numbers import number
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from .agreement import compared, lifted_map
from .fill_kernels import between
from .hull import EMPTY, Hull
from .stack import ViewStack
from .sweep import DepthMap


@dataclass(frozen=True)
class FillSettings:
    """Of the guessed depths."""

    step: int = number(
        2, "px", "between px that are guessed: they are faint, and need not be dense", FIRST_TRIED, LOOKED_AT
    )
    deepest: float = number(
        1.25,
        "ratio",
        "of the depths on both sides, above which they are two surfaces and an edge lies between",
        FIRST_TRIED,
        LOOKED_AT,
    )


SETTINGS = FillSettings()


def filled_maps(
    maps: Sequence[DepthMap],
    views: ViewStack,
    wanted: Sequence[NDArray[np.bool_]],
    hull: Hull | None,
    settings: FillSettings = SETTINGS,
) -> list[DepthMap]:
    """Depths of px that have none, of confidence 1; only those that no map and no empty cell contradicts.

    Args:
        maps: checked ones; wanted: [H, W] of each, px that show something.
    """
    guessed = [_guessed(one, want, settings) for one, want in zip(maps, wanted, strict=True)]
    points = [lifted_map(one, views) for one in guessed]
    own = np.concatenate([np.full(len(p), i, np.int32) for i, p in enumerate(points)])
    every = np.concatenate(points)
    free = compared(every, own, maps, views).conflict == 0
    if hull is not None:
        free &= hull.at(every) != EMPTY
    kept, at = [], 0
    for one, some in zip(guessed, points, strict=True):
        there = one.depth > 0
        depth = np.zeros_like(one.depth)
        depth[there] = one.depth[there] * free[at : at + len(some)]
        at += len(some)
        kept.append(DepthMap(one.view, depth, (depth > 0).astype(np.float32)))
    return kept


def _guessed(one: DepthMap, wanted: NDArray[np.bool_], settings: FillSettings) -> DepthMap:
    """Between the nearest trusted px of the row, and of the column; where both are there, they must agree."""
    by_row, by_column = (
        _along_rows(one.depth, wanted, settings),
        _along_rows(np.ascontiguousarray(one.depth.T), np.ascontiguousarray(wanted.T), settings).T,
    )
    mean = np.where(by_row * by_column > 0, 0.5 * (by_row + by_column), by_row + by_column)
    apart = np.maximum(by_row, by_column) > settings.deepest * np.minimum(by_row, by_column)
    mean = np.where((by_row * by_column > 0) & apart, 0.0, mean)
    grid = np.zeros_like(wanted)
    grid[:: settings.step, :: settings.step] = True
    depth = np.divide(1.0, mean, out=np.zeros_like(mean), where=(mean > 0) & grid)
    return DepthMap(one.view, depth, (depth > 0).astype(np.float32))


def _along_rows(depth: NDArray[np.float32], wanted: NDArray[np.bool_], settings: FillSettings) -> NDArray[np.float32]:
    guess = np.zeros_like(depth)
    compiled.run(between, len(depth), depth, wanted, settings.deepest, guess, grain=16)
    return guess
