"""Depths where nobody confirms any: guessed between what is known, kept where no photo looks through.

Between known px a depth is what lies between; beside all of them it is that of the nearest. Wrong guesses are faint,
and a start for what the photos show there; without any, fog grows out of surfaces that are near.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .. import compiled
from ..numbers import number
from ..training.density.initial import depth_between
from .agreement import compared, lifted_map
from .hull import EMPTY, Hull
from .maps import wanted_pixels
from .stack import Floats, ViewStack
from .sweep import DepthMap

#: What the numbers below were chosen on, and checked on: docs/studies/points.md.
_CHOSEN = "copr, sharp, 400 px, and a room rendered by Cycles: drafts"
_CHECKED = "copr blurred, banana and brighton, sharp and blurred: drafts"


@dataclass(frozen=True)
class GuessSettings:
    """Of what a guess is made of, and how dense it is."""

    fewest_points: int = number(20, "points", "that a view must see before depths between them are guessed")
    most_points: int = number(3000, "points", "that the guess of a view is made of: more cost time and change little")
    beside: int = number(24, "points", "nearest to one in a view, which may hide it if they lie all around it")
    steepest: float = number(
        4.0, "ratio", "change of the depth's logarithm over an angle in radians: surfaces are not seen more grazingly"
    )
    side: int = number(128, "px", "of the longer side, at which depths are guessed: of larger views, every few px")
    step: int = number(3, "px", "between guessed samples where nothing is confirmed", _CHOSEN, _CHECKED)


SETTINGS = GuessSettings()


def thinned(pixels: Floats, depth: Floats, settings: GuessSettings = SETTINGS) -> tuple[Floats, Floats]:
    """Some of a view's points, evenly chosen: no more than a guess needs."""
    every = max(1, len(depth) // settings.most_points)
    return pixels[::every], depth[::every]


def guessed_between(
    pixels: Floats, depth: Floats, shape: tuple[int, ...], settings: GuessSettings = SETTINGS
) -> Floats:
    """[H, W] depth between a view's points, [N, 2] px and [N], at its px' middles; of large views, of every few."""
    every = -(-max(shape) // settings.side)
    rows, columns = np.indices([-(-side // every) for side in shape])
    middles = every * (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5)
    coarse = depth_between(pixels, depth, middles).reshape(rows.shape)
    return coarse.repeat(every, axis=0).repeat(every, axis=1)[: shape[0], : shape[1]]


def guessed_from(one: DepthMap, points: Floats, views: ViewStack, settings: GuessSettings = SETTINGS) -> Floats | None:
    """[H, W] depth between the px of a checked map and the points [N, 3] before its view; None if these are too few."""
    rows, columns = np.nonzero(one.depth > 0)
    own = np.stack([columns, rows], axis=1) + 0.5
    own, depth = thinned(own, one.depth[rows, columns].astype(np.float64), settings)
    pixels, more = views.depths(one.view, points)
    front = unhidden(pixels, more, float(views.focals[one.view]), settings)
    pixels, depth = np.concatenate([own, pixels[front]]), np.concatenate([depth, more[front]])
    return None if len(depth) < settings.fewest_points else guessed_between(pixels, depth, one.depth.shape, settings)


def unhidden(pixels: Floats, depth: Floats, focal: float, settings: GuessSettings = SETTINGS) -> NDArray[np.bool_]:
    """[N] points of a view that nearer ones do not surround: what lies behind an object is no surface of its front.

    A nearer point hides one beside it if a surface through both would be seen at too grazing an angle.
    """
    count = min(settings.beside + 1, len(depth))
    if count < 4:
        return np.ones(len(depth), bool)
    apart, index = cKDTree(pixels).query(pixels, k=count)
    logs = np.log(depth)
    steep = logs[:, None] - logs[index] > settings.steepest * apart / focal
    steep &= apart > 0
    many = steep.sum(axis=1)
    asked = np.flatnonzero(many >= 3)  # (two surround nothing)
    free = np.ones(len(depth), bool)
    free[asked] = _widest_gap(pixels[index[asked]] - pixels[asked, None], steep[asked], many[asked]) >= np.pi
    return free


def _widest_gap(towards: Floats, counts: NDArray[np.bool_], many: NDArray[np.int64]) -> Floats:
    """[K] radians between neighbours around each of K px, all around.

    Args:
        towards: [K, B, 2] to others; counts: [K, B] which of them count; many: [K] how many, at least one.
    """
    angles = np.sort(np.where(counts, np.arctan2(towards[..., 1], towards[..., 0]), np.inf), axis=1)
    turned = np.concatenate([angles, angles[:, :1] + 2 * np.pi], axis=1)
    # (the first one again, a turn later, behind the last)
    turned[np.arange(len(many)), many] = angles[:, 0] + 2 * np.pi
    with np.errstate(invalid="ignore"):
        gaps = np.diff(turned, axis=1)
    return np.asarray(np.where(np.arange(gaps.shape[1]) < many[:, None], gaps, 0.0).max(axis=1, initial=0.0))


def unconfirmed(
    guesses: Sequence[Floats | None],
    checked: Sequence[DepthMap],
    views: ViewStack,
    hull: Hull | None,
    settings: GuessSettings = SETTINGS,
) -> list[DepthMap]:
    """The guesses at every few px where nothing was confirmed, and no confirmed surface or empty cell contradicts."""
    left = []
    for guess, one in zip(guesses, checked, strict=True):
        if guess is None:
            left.append(DepthMap(one.view, np.zeros_like(one.depth), np.zeros_like(one.confidence)))
            continue
        grid = np.zeros(guess.shape, bool)
        grid[:: settings.step, :: settings.step] = True
        there = wanted_pixels(views, one.view) & grid & (one.depth == 0)
        left.append(DepthMap(one.view, np.where(there, guess, 0.0).astype(np.float32), there.astype(np.float32)))
    with ThreadPoolExecutor(compiled.threads()) as pool:
        return list(pool.map(lambda guess: _unseen_through(guess, checked, views, hull), left))


def _unseen_through(guess: DepthMap, checked: Sequence[DepthMap], views: ViewStack, hull: Hull | None) -> DepthMap:
    """Those that no confirmed surface lies behind, and no photo shows to be empty."""
    points = lifted_map(guess, views)
    others = [one for one in checked if one.view != guess.view]
    free: NDArray[np.bool_] = compared(points, np.full(len(points), -1, np.int32), others, views).conflict == 0
    if hull is not None:
        free &= hull.at(points) != EMPTY
    there = guess.depth > 0
    depth = np.zeros_like(guess.depth)
    depth[there] = guess.depth[there] * free
    return DepthMap(guess.view, depth, (depth > 0).astype(np.float32))
