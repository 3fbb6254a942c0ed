"""Which places have changed, and how they hang together: neighbourhoods of several sizes, false ones kept few.

A place is asked alone and together with its neighbours. Motions are tested by Hotelling's T^2 (few photos make a
covariance uncertain), and of all tests those are kept that Benjamini and Hochberg (1995) keep at a given rate of false
ones. Where photos contradict the surface by more than any motion explains, it is not there any more (or not alike).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import f as fisher
from scipy.stats import t as student

from .evidence import Array, Evidence, Places
from .motion import CommonMotion, Motion, between, enough, pooled
from .settings import EVIDENCE, REGIONS

Flags = NDArray[np.bool_]
#: Standard deviations of a normal distribution for its median absolute deviation.
_ROBUST = 1.4826


@dataclass(frozen=True)
class Tested:
    """What was found at each place.

    Attributes:
        held: [N] enough photos of both twins see it.
        motion: in its smallest neighbourhood that has moved, or its own.
        moved: [N] more than chance; gone: [N] contradicted by more than a motion explains.
        ratio: [N] logarithm of the residual's energy after and before, less the whole surface's.
    """

    held: Flags
    motion: Motion
    moved: Flags
    gone: Flags
    ratio: Array = field(repr=False)


def neighbourhoods(places: Places, radius: float, held: Flags) -> csr_array:
    """[N, N] 1 where a held place lies within `radius` px-equivalents of another."""
    count = len(places.at)
    if radius <= 0:
        return csr_array((held.astype(np.float32), (np.arange(count), np.arange(count))), shape=(count, count))
    pixel = float(np.median(places.pixel))
    pairs = cKDTree(places.at / pixel).query_pairs(radius, output_type="ndarray")
    rows = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(count)])
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(count)])
    return csr_array((held[columns].astype(np.float32), (rows, columns)), shape=(count, count))


def tested(own: Evidence, other: Evidence, places: Places, common: CommonMotion) -> Tested:
    """Asks every place alone and in its neighbourhoods.

    Args:
        other: with the common motion taken out of it.
    """
    held = enough(own, other)
    found, chances = [], []
    for radius in REGIONS.radii:
        members = neighbourhoods(places, radius, held)
        motion = between(pooled(own, members), pooled(other, members))
        motion = Motion(motion.by, motion.covariance + common.spread(members), motion.seen)
        found.append(motion)
        chances.append(np.where(held, chance(motion), 1.0))
    kept = not_by_chance(np.stack(chances), held) & np.stack([m.size > REGIONS.smallest for m in found])
    moved = kept.any(axis=0) & held
    smallest = np.where(moved, kept.argmax(axis=0), 0)
    at = np.arange(len(held))
    moved &= prefers(found[0], np.stack([m.by for m in found])[smallest, at])
    by, covariance = (np.stack([getattr(m, part) for m in found])[smallest, at] for part in ("by", "covariance"))
    motion = Motion(by, covariance, found[0].seen)
    ratio = energies(own, other, held)
    gone = contradicted(own, other, held, ratio) & (left_over(own, other, found[0]) > REGIONS.left)
    return Tested(held, motion, moved, gone, ratio)


def chance(motion: Motion) -> Array:
    """[N] probability of so large a motion where nothing moves: Hotelling's T^2 with as many photos.

    The direction that cameras see worst (mostly towards them) is asked alone: beside two that they see well, what
    shows there only would drown.
    """
    photos = np.maximum(motion.seen, 5)
    sizes, axes = np.linalg.eigh(motion.covariance)
    squares = np.einsum("nij,ni->nj", axes, motion.by) ** 2 / sizes
    along = fisher.sf(squares[:, 2], 1, photos - 1)
    across = squares[:, :2].sum(axis=1)
    beside = fisher.sf(across * (photos - 2) / (2 * (photos - 1)), 2, photos - 2)
    return np.asarray(np.minimum(1.0, 2.0 * np.minimum(along, beside)))


def not_by_chance(chances: Array, held: Flags) -> Flags:
    """[K, N] which of K tests of N places are kept at the rate of false ones that is allowed (Benjamini, Hochberg)."""
    counted = np.sort(chances[:, held].ravel())
    if not len(counted):
        return np.zeros(chances.shape, bool)
    below = np.flatnonzero(counted <= REGIONS.rate * np.arange(1, len(counted) + 1) / len(counted))
    limit = counted[below[-1]] if len(below) else -1.0
    return np.asarray((chances <= limit) & held)


def prefers(own: Motion, by: Array) -> Flags:
    """[N] places that fit a motion better than none: those beside what has moved share its neighbourhoods only."""
    weighted = np.linalg.solve(own.covariance, by[..., None])[..., 0]
    return np.asarray((own.by * weighted).sum(axis=1) > 0.5 * (by * weighted).sum(axis=1))


def energies(own: Evidence, other: Evidence, held: Flags) -> Array:
    """[N] logarithm of the mean energy of the other photos' residual over that of the twin's own; 0 in the median."""
    first, second = _logarithms(own)[0], _logarithms(other)[0]
    ratio = np.where(held, second - first, 0.0)
    return np.asarray(np.where(held, ratio - np.median(ratio[held]) if held.any() else 0.0, 0.0))


def _logarithms(found: Evidence) -> tuple[Array, Array]:
    """[N] mean over photos of the logarithm of the energy, and the variance of that mean."""
    sees = found.sees
    values = np.where(sees, np.log(found.energies.astype(np.float64) + 1e-9), 0.0)
    count = np.maximum(sees.sum(axis=0), 1)
    mean = values.sum(axis=0) / count
    variance = (np.where(sees, values - mean, 0.0) ** 2).sum(axis=0) / np.maximum(count - 1, 1)
    return mean, variance / count


def contradicted(own: Evidence, other: Evidence, held: Flags, ratio: Array) -> Flags:
    """[N] where the other photos differ by far more than the twin's own, beyond what places scatter."""
    if not held.any():
        return held
    variance = _logarithms(own)[1] + _logarithms(other)[1]
    spread = _ROBUST * float(np.median(np.abs(ratio[held])))
    size = ratio / np.sqrt(variance + spread**2 + 1e-12)
    chances = np.where(held, student.sf(size, np.maximum(np.minimum(own.seen, other.seen) - 1, 1)), 1.0)
    return np.asarray(not_by_chance(chances[None], held)[0] & (ratio > np.log(REGIONS.ratio)))


def left_over(own: Evidence, other: Evidence, motion: Motion) -> Array:
    """[N] share of what the other photos contradict beyond the twin's own that its motion does not explain."""
    values = 3 * EVIDENCE.window**2
    whole = other.energies.sum(axis=0, dtype=np.float64) * values
    usual = own.energies.sum(axis=0, dtype=np.float64) * values * other.seen / np.maximum(own.seen, 1)
    explained = np.einsum("ni,nij,nj->n", motion.by, other.matrices.sum(axis=0, dtype=np.float64), motion.by)
    return np.asarray(1.0 - explained / np.maximum(whole - usual, 1e-12))


def components(flags: Flags, edges: NDArray[np.int64], area: Array) -> list[NDArray[np.int64]]:
    """Places that hang together on the mesh by flagged ones, the largest first; small ones are dropped.

    Args:
        area: [N] of each place, px-equivalents squared.
    """
    inside = edges[flags[edges[:, 0]] & flags[edges[:, 1]]]
    count = len(flags)
    graph = csr_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    sums = np.bincount(label[flags], area[flags], minlength=label.max() + 1 if count else 0)
    large = np.flatnonzero(sums >= REGIONS.area)
    return [np.flatnonzero(flags & (label == one)) for one in large[np.argsort(-sums[large])]]
