"""Points of the twin's surface, and where each photo shows them: what a bundle adjustment of the cameras goes by.

Photos that were shaken show few features alike, each along its own path. The twin, seen along a photo's path, shows
what the photo would be were camera and surface where they are thought to be; where it lies beside the photo, one of
them is not. No two photos are compared, and their paths do not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from ...camera import Camera
from ...evaluation.shifts import shifts_between
from ...numbers import number
from .bundle import Floats, Observations

#: What the numbers below were tried on; docs/real_blur.md has the figures.
_FIRST = "the first value; points by spacing 3 or 4 and errors up to 0.2 or 0.6 px were alike"


@dataclass(frozen=True)
class TrackSettings:
    """Of the points, and of what counts as seeing one."""

    spacing: int = number(4, "px of the grid", "between points of one photo", _FIRST)
    points: int = number(3000, "count", "at most, by chance", _FIRST)
    surest: float = number(0.4, "px", "error of the shift in the photo that a point is taken from, at most", _FIRST)
    largest_error: float = number(0.8, "px", "error of the shift in any other photo, at most", _FIRST)
    smallest_error: float = number(0.05, "px", "error of any shift, at least: no window is aligned better", _FIRST)
    largest_shift: float = number(4.0, "px", "that a point may lie beside where it is thought to be", _FIRST)
    same_depth: float = number(0.02, "share of the depth", "within which a photo sees the very point", _FIRST)
    edge: int = number(4, "px", "of the frame's border that do not count", _FIRST)
    fewest_views: int = number(3, "photos", "that see a point: two cannot contradict each other much", _FIRST)
    fewest: int = number(200, "observations", "without which nothing is adjusted", _FIRST)
    nearest: int = number(8, "points", "whose mean movement a Gaussian follows", _FIRST)


SETTINGS = TrackSettings()


class Limits(Protocol):
    """What counts as seeing a point; px of the grid, and a share of the depth."""

    @property
    def edge(self) -> int: ...

    @property
    def same_depth(self) -> float: ...

    @property
    def largest_error(self) -> float: ...

    @property
    def largest_shift(self) -> float: ...

    @property
    def smallest_error(self) -> float: ...


@dataclass(frozen=True)
class Sighting:
    """A photo beside the twin.

    Attributes:
        camera: where the camera was on average, on the grid.
        shift: [2, H, W] px (x, y), of the photo against what the twin shows of it.
        shift_error: [H, W] px.
        depth: [H, W] of the surface, 0 where there is none.
        counts: [H, W] bool px that count, None for all.
    """

    camera: Camera
    shift: NDArray[np.float32]
    shift_error: NDArray[np.float32]
    depth: NDArray[np.float32]
    counts: NDArray[np.bool_] | None = None

    def error(self) -> Floats:
        """[H, W] px, of the shift; infinite where nothing is to be seen."""
        there = (self.depth > 0) if self.counts is None else (self.depth > 0) & self.counts
        return np.where(there, self.shift_error, np.inf)


@dataclass(frozen=True)
class LaidBeside:
    """A photo [3, H, W] and what the twin shows of it, sRGB; others as of `Sighting`."""

    camera: Camera
    shown: NDArray[np.float32]
    photo: NDArray[np.float32]
    depth: NDArray[np.float32]
    counts: NDArray[np.bool_] | None = None


def sighted(one: LaidBeside) -> Sighting:
    """Where the photo lies beside the twin, at half the precision, as those of all photos are held at a time."""
    found = shifts_between(one.shown, one.photo, one.counts)
    return Sighting(one.camera, found.shift.astype(np.float32), found.error.astype(np.float32), one.depth, one.counts)


def tracks_through(
    sightings: Sequence[Sighting], random: np.random.Generator, settings: TrackSettings = SETTINGS
) -> tuple[Floats, Observations] | None:
    """Points [M, 3] on the surfaces that the photos show, and where; None where there are too few."""
    positions = np.concatenate([lifted(sighting, settings) for sighting in sightings])
    positions = positions[random.permutation(len(positions))[: settings.points]]
    found = observed(positions, sightings, settings)
    enough = np.bincount(found.point, minlength=len(positions))[found.point] >= settings.fewest_views
    if int(enough.sum()) < settings.fewest:
        return None
    used, point = np.unique(found.point[enough], return_inverse=True)
    return positions[used], Observations(found.camera[enough], point, found.position[enough], found.error[enough])


def observed(positions: Floats, sightings: Sequence[Sighting], settings: TrackSettings = SETTINGS) -> Observations:
    """Where photos show points [M, 3]; some may be seen by none."""
    found = [seen_points(positions, one.camera, (one.shift, one.error(), one.depth), settings) for one in sightings]
    point, position, error = (np.concatenate([one[k] for one in found]) for k in range(3))
    return Observations(np.repeat(np.arange(len(found)), [len(one[0]) for one in found]), point, position, error)


def lifted(sighting: Sighting, settings: TrackSettings = SETTINGS) -> Floats:
    """[K, 3] world, points of the surface on an even grid of a photo's px where its shift is sure."""
    height, width = sighting.depth.shape
    every, first = settings.spacing, settings.spacing // 2
    rows, columns = np.mgrid[first:height:every, first:width:every]
    sure = sighting.error()[rows, columns] < settings.surest
    return on_surface(sighting.camera, rows[sure], columns[sure], sighting.depth)


def on_surface(
    camera: Camera, rows: NDArray[np.int64], columns: NDArray[np.int64], depth: NDArray[np.floating]
) -> Floats:
    """[K, 3] world, what the middles of px at `rows`, `columns` [K] show, where their depth [H, W] is known."""
    z = depth[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - camera.cx) / camera.fx * z, (rows + 0.5 - camera.cy) / camera.fy * z, z], axis=1)
    return np.asarray((local[np.isfinite(z) & (z > 0)] - camera.translation) @ camera.rotation)


def seen_points(
    points: Floats,
    camera: Camera,
    maps: tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]],
    limits: Limits,
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Which of the points [M, 3] a photo sees, [K, 2] px from the optical axis, and [K] px how certain that is.

    Args:
        maps: [2, H, W] shifts of the photo against the twin, [H, W] their errors, and [H, W] the twin's depth.
    """
    shifts, errors, depth = maps
    height, width = depth.shape
    local = points @ camera.rotation.T + camera.translation
    z = local[:, 2]
    safe = np.where(z > 0, z, 1.0)[:, None]
    position = local[:, :2] / safe * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    inside = (z > 0) & (position > limits.edge).all(axis=1)
    index = np.flatnonzero(inside & (position < [width - limits.edge, height - limits.edge]).all(axis=1))
    at = [position[index, 1] - 0.5, position[index, 0] - 0.5]
    here, error, x, y = (map_coordinates(p, at, order=1, mode="nearest") for p in (depth, errors, *shifts))
    shift = np.stack([x, y], axis=1)
    good = (np.abs(here / z[index] - 1.0) < limits.same_depth) & (error < limits.largest_error)
    good &= np.linalg.norm(shift, axis=1) < limits.largest_shift
    where = position[index] + shift - [camera.cx, camera.cy]
    return index[good], where[good], np.maximum(error[good], limits.smallest_error)


def carried(means: Floats, before: Floats, after: Floats, settings: TrackSettings = SETTINGS) -> Floats:
    """[N, 3] places that go along with the points [M, 3] near them; such as are not finite stay so."""
    finite = np.isfinite(means).all(axis=1)
    some = means[finite]
    near = cKDTree(before).query(some, k=min(settings.nearest, len(before)), workers=-1)[1].reshape(len(some), -1)
    moved = means.copy()
    moved[finite] += (after - before)[near].mean(axis=1)
    return moved
