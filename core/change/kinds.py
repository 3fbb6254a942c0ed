"""From places that have changed to regions: what became of each, where, and by how much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from .evidence import Array
from .findings import Region
from .motion import Motion, between, pooled
from .pair import Compared
from .parts import parted
from .regions import components
from .settings import EVIDENCE, REGIONS
from .sizes import sized
from .surface import Surface

Indices = NDArray[np.int64]
#: Standard deviations of a normal distribution for its median absolute deviation.
_ROBUST = 1.4826


def regions_of(found: Compared) -> list[Region]:
    """What has changed of a surface: what is contradicted, and how far all else has moved."""
    contradicted, moving = _gone_and_moving(found)
    return sorted([*contradicted, *_moved(found, moving)], key=lambda region: -region.area)


def vanished_of(found: Compared) -> list[Region]:
    """What stands before one set of photos only."""
    return [region for region in _gone_and_moving(found)[0] if region.kind == "vanished"]


def _gone_and_moving(found: Compared) -> tuple[list[Region], list[Indices]]:
    """What is contradicted, with the motions that its window sees around it, and places that have moved."""
    surface, tested = found.surface, found.tested
    tree = cKDTree(surface.places.at / np.median(surface.places.pixel))
    free, gone, regions = tested.moved & ~tested.gone, tested.gone.copy(), list[Region]()
    moving = list[Indices]()
    for part in components(free | gone, surface.edges, surface.area):
        if gone[part].mean() < REGIONS.minor:  # the edges of what has moved
            moving.append(part)
            free[part] = gone[part] = False
    for seed in components(gone, surface.edges, surface.area):
        near = np.unique(np.concatenate(tree.query_ball_point(tree.data[seed], REGIONS.halo)).astype(np.int64))
        regions.append(_contradicted(found, seed, np.union1d(seed, near[free[near]])))
        free[near] = False
    return regions, [*moving, *components(free, surface.edges, surface.area)]


def _contradicted(found: Compared, seed: Indices, places: Indices) -> Region:
    """Gone, new, wider, narrower, or only painted: by the surfaces' depths, then by how its sides have moved."""
    gap = found.gap[seed]
    farther, nearer = (np.nan_to_num(sign * gap, nan=0.0) > REGIONS.front for sign in (1.0, -1.0))
    for kind, part in (("vanished", farther), ("appeared", nearer)):
        if part.mean() > REGIONS.stands_out:
            height = np.abs(gap[part])
            scatter = _ROBUST * float(np.median(np.abs(height - np.median(height)))) / np.sqrt(len(height))
            deviation = float(np.hypot(REGIONS.depth, scatter))
            return _region(found, kind, seed[part], float(np.median(height)), deviation, exact=True)
    return _grown(found, places) or _region(found, "repainted", places, None, None)


def _moved(found: Compared, regions: list[Indices]) -> list[Region]:
    """Regions whose two sides go apart, and the parts of all others, each with a motion of its own."""
    grown = [(places, _grown(found, places)) for places in regions]
    parts = [
        part
        for places, region in grown
        if region is None
        for part in parted(found, places, _together(found, _within(found, places, EVIDENCE.window)))
    ]
    said = [region for _, region in grown if region is not None]
    if not parts:
        return said
    motions = sized(found, parts)
    for part, way, deviation in zip(parts, motions.by, motions.deviation, strict=True):
        said.append(_region(found, "moved", part.places, float(np.linalg.norm(way)), float(deviation), way))
    return said


def _within(found: Compared, places: Indices, depth: float) -> Indices:
    """Those at least `depth` px-equivalents from held places that have not changed; half as far, or all, if too few."""
    away = found.depth_of(places)
    for least in (depth, depth / 2):
        if (away > least).sum() >= REGIONS.side_places:
            return np.asarray(places[away > least])
    return places


def _together(found: Compared, places: Indices) -> Motion:
    """[1] motion of places as if they moved as one."""
    count = len(found.surface.places.at)
    members = csr_array((np.ones(len(places), np.float32), (np.zeros(len(places), int), places)), shape=(1, count))
    motion = between(pooled(found.own, members), pooled(found.other, members))
    return Motion(motion.by, motion.covariance + found.common.spread(members), motion.seen)


def _grown(found: Compared, places: Indices) -> Region | None:
    """A region whose two sides have gone opposite ways: where one of them stands still, the other has moved."""
    at = found.surface.places.at[places] / found.surface.places.pixel[places, None]
    explained = places[~found.tested.gone[places]]  # what no motion explains says nothing of the way
    if len(explained) < REGIONS.side_places:
        return None
    motion = found.tested.motion
    by = motion.by[explained] / np.trace(motion.covariance[explained], axis1=1, axis2=2)[:, None]
    axis = np.linalg.eigh(by.T @ by)[1][:, 2]
    near = cKDTree(at).query_ball_point(at, REGIONS.radii[-1])
    beside = (at - np.stack([at[some].mean(axis=0) for some in near])) @ axis
    asked = np.isin(places, explained)
    sides = places[asked & (beside > REGIONS.beside)], places[asked & (beside < -REGIONS.beside)]
    if min(len(side) for side in sides) < REGIONS.side_places:
        return None
    upper, lower = (_together(found, side) for side in sides)
    apart = float((upper.by[0] - lower.by[0]) @ axis)
    shared = float((upper.by[0] + lower.by[0]) @ axis) / 2.0
    deviation = float(np.sqrt(axis @ (upper.covariance[0] + lower.covariance[0]) @ axis))
    if abs(apart) < max(REGIONS.sure * deviation, REGIONS.smallest, REGIONS.opposite * abs(shared)):
        return None
    return _region(found, "grew" if apart > 0 else "shrank", places, abs(apart), deviation)


def _region(
    found: Compared,
    kind: str,
    places: Indices,
    value: float | None,
    deviation: float | None,
    motion: Array | None = None,
    exact: bool = False,
) -> Region:
    """A region; its border lies half a window inside the places that see it, unless they are `exact`."""
    surface = found.surface
    places = places if exact else _within(found, places, EVIDENCE.window / 2)
    centre = np.average(surface.places.at[places], axis=0, weights=surface.area[places])
    direction = "" if motion is None else _direction(surface, centre, motion)
    pixel, area = float(np.median(surface.places.pixel[places])), float(surface.area[places].sum())
    by = np.zeros(3) if motion is None else motion
    return Region(kind, centre, pixel, area, value, deviation, by, direction, places)


def _direction(surface: Surface, centre: Array, motion: Array) -> str:
    """In words, for cameras in the middle of all."""
    towards = np.mean([camera.centre for camera in surface.cameras], axis=0) - centre
    share = float(motion @ towards / (np.linalg.norm(motion) * np.linalg.norm(towards) + 1e-30))
    if abs(share) < REGIONS.towards:
        return "sideways"
    return "towards the cameras" if share > 0 else "away from the cameras"
