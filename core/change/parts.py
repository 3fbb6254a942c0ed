"""Parts of a region that have moved each by itself.

Gaps that are narrower than the blur do not part what moves: windows on both sides see it all. But the motion that they
show falls off between the parts, so that each is found by its peak. How large the motions are is said by `sizes`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .evidence import Array
from .motion import Motion, between, pooled
from .pair import Compared
from .regions import components, neighbourhoods
from .settings import EVIDENCE, PARTS
from .surface import Surface

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """Places that have moved as one.

    Attributes:
        places: of the region, all that lie nearer to this part than to its others.
        about: all about it: how the motion falls off there says how far the part reaches.
        supports: those that may have moved themselves, for each share of the peak that is tried.
        inner: of the likeliest, away from what has not moved: these say which way.
        windows: how many lie about it beside one another.
    """

    places: Indices
    about: Indices
    supports: tuple[Indices, ...]
    inner: Indices
    windows: float


def parted(found: Compared, places: Indices, whole: Motion) -> list[Part]:
    """The parts of a region [M] whose places together have moved by `whole` [1]; itself where it has one."""
    surface, held = found.surface, found.tested.held
    local = local_motion(found)
    way = whole.by[0] / max(float(np.linalg.norm(whole.by[0])), 1e-12)
    along, sure = local.by @ way, np.sqrt(np.einsum("i,nij,j->n", way, local.covariance, way))
    peak = float(np.quantile(along[places], PARTS.peak))
    cores = _cores(surface, places, along, peak, PARTS.sure * float(np.median(sure[places]))) or [places]
    at = surface.places.at / np.median(surface.places.pixel)
    away = np.stack([cKDTree(at[core]).query(at)[0] for core in cores])
    nearest, inside = away.argmin(axis=0), np.isin(np.arange(len(held)), places)
    parts = []
    for index, core in enumerate(cores):
        own = held & (nearest == index) & (away[index] < PARTS.about)
        supports = tuple(_some(np.flatnonzero(own & (along > share * peak)), core) for share in PARTS.shares)
        windows = float(surface.area[own].sum()) / (EVIDENCE.window + 2 * PARTS.near) ** 2
        mine = np.flatnonzero(inside & (nearest == index))
        parts.append(Part(mine, np.flatnonzero(own), supports, _inner(found, core), max(windows, 2.0)))
    return parts


@dataclass(frozen=True, eq=False)
class _Peak:
    """Places about a peak, and how high it is, px-equivalents."""

    core: Indices
    top: float


def _cores(surface: Surface, places: Indices, along: Array, peak: float, deep: float) -> list[Indices]:
    """Peaks of a region's motion [N]: what hangs together about each, down to where it meets another.

    Args:
        deep: by how much motions must fall off between two peaks for these to be two.
    """
    peaks = list[_Peak]()
    for level in PARTS.levels:
        flags = np.zeros(len(along), bool)
        flags[places[along[places] > level * peak]] = True
        for found in components(flags, surface.edges, surface.area):
            held = [one for one in peaks if np.isin(one.core, found).any()]
            apart = [one for one in held if one.top - level * peak > deep]
            peaks = [one for one in peaks if one not in held]
            if len(apart) > 1:
                peaks += apart
            else:
                top = float(np.quantile(along[found], PARTS.peak))
                peaks.append(_Peak(found, max([top, *(one.top for one in held)])))
    return [one.core for one in peaks]


def local_motion(found: Compared) -> Motion:
    """Of each place, asked with what lies right about it."""
    near = neighbourhoods(found.surface.places, PARTS.near, found.tested.held)
    return between(pooled(found.own, near), pooled(found.other, near))


def _some(places: Indices, instead: Indices) -> Indices:
    return places if len(places) >= PARTS.places else instead


def _inner(found: Compared, core: Indices) -> Indices:
    """Places of a core that lie farthest from what is held and does not belong to it."""
    away = found.depth_of(core)
    inside = away > min(PARTS.inside, float(np.sort(away)[-min(PARTS.places, len(away))]) - 1e-9)
    return np.asarray(core[inside])
