"""Points of the twin's surface, and where each photo shows them: what a bundle adjustment of the cameras goes by.

Photos that were shaken show few features alike, each along its own path. The twin, seen along a photo's path, shows
what the photo would be were camera and surface where they are thought to be; where it lies beside the photo, one of
them is not. No two photos are compared, and their paths do not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from ..camera import Camera
from ..evaluation.shifts import Shifts
from ..numbers import number
from .bundle import Floats, Observations

#: What the numbers below were tried on; docs/real_blur.md has the figures.
_FIRST = "the first value; points by spacing 3 or 4 and errors up to 0.2 or 0.6 px were alike"


@dataclass(frozen=True)
class TrackSettings:
    """Of the points, and of what counts as seeing one."""

    spacing: int = number(4, "px of the grid", "between points of one photo", _FIRST)
    points: int = number(3000, "count", "at most, by chance", _FIRST)
    surest: float = number(0.4, "px", "error of the shift in the photo that a point is taken from, at most", _FIRST)
    sure: float = number(0.8, "px", "error of the shift in any other photo, at most", _FIRST)
    exact: float = number(0.05, "px", "that is added to every error: windows that agree are no surer", _FIRST)
    farthest: float = number(4.0, "px", "that a point may lie beside where it is thought to be", _FIRST)
    alike: float = number(0.02, "share of the depth", "within which a photo sees the very point", _FIRST)
    border: int = number(4, "px", "of the frame's border that do not count", _FIRST)
    fewest_views: int = number(3, "photos", "that see a point: two cannot contradict each other much", _FIRST)
    fewest: int = number(200, "observations", "without which nothing is adjusted", _FIRST)
    nearest: int = number(8, "points", "whose mean movement a Gaussian follows", _FIRST)


SETTINGS = TrackSettings()


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

    @staticmethod
    def of(
        camera: Camera, shifts: Shifts, depth: NDArray[np.float32], counts: NDArray[np.bool_] | None = None
    ) -> Sighting:
        """With shifts at half the precision, as those of all photos are held at a time."""
        return Sighting(camera, shifts.shift.astype(np.float32), shifts.error.astype(np.float32), depth, counts)

    def error(self) -> Floats:
        """[H, W] px, of the shift; infinite where nothing is to be seen."""
        there = (self.depth > 0) if self.counts is None else (self.depth > 0) & self.counts
        return np.where(there, self.shift_error, np.inf)


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
    found = [_seen(positions, sighting, settings) for sighting in sightings]
    point, position, error = (np.concatenate([one[k] for one in found]) for k in range(3))
    return Observations(np.repeat(np.arange(len(found)), [len(one[0]) for one in found]), point, position, error)


def lifted(sighting: Sighting, settings: TrackSettings = SETTINGS) -> Floats:
    """[K, 3] world, points of the surface on an even grid of a photo's px where its shift is sure."""
    height, width = sighting.depth.shape
    every, first = settings.spacing, settings.spacing // 2
    rows, columns = np.mgrid[first:height:every, first:width:every]
    sure = sighting.error()[rows, columns] < settings.surest
    rows, columns = rows[sure], columns[sure]
    camera, z = sighting.camera, sighting.depth[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - camera.cx) / camera.fx * z, (rows + 0.5 - camera.cy) / camera.fy * z, z], axis=1)
    return np.asarray((local - camera.translation) @ camera.rotation)


def _seen(positions: Floats, sighting: Sighting, settings: TrackSettings) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Which of the points a photo sees, where [K, 2], px from the optical axis, and how unsure that is [K], px."""
    camera, edge = sighting.camera, settings.border
    local = positions @ camera.rotation.T + camera.translation
    z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
    middle = np.array([camera.cx, camera.cy])
    at = local[:, :2] / z[:, None] * (camera.fx, camera.fy) + middle
    inside = (at > edge).all(axis=1) & (at < (camera.width - edge, camera.height - edge)).all(axis=1)
    point = np.flatnonzero(inside)
    columns, rows = np.floor(at[point]).astype(int).T
    error = sighting.error()[rows, columns]
    shift = np.stack(
        [map_coordinates(part, (at[point] - 0.5).T[::-1], order=1, mode="nearest") for part in sighting.shift], axis=1
    )
    same = np.abs(sighting.depth[rows, columns] / z[point] - 1.0) < settings.alike
    good = same & (error < settings.sure) & (np.abs(shift).max(axis=1, initial=0.0) < settings.farthest)
    point = point[good]
    return point, at[point] + shift[good] - middle, np.hypot(error[good], settings.exact)


def carried(means: Floats, before: Floats, after: Floats, settings: TrackSettings = SETTINGS) -> Floats:
    """[N, 3] places that go along with the points [M, 3] near them; such as are not finite stay so."""
    finite = np.isfinite(means).all(axis=1)
    some = means[finite]
    near = cKDTree(before).query(some, k=min(settings.nearest, len(before)), workers=-1)[1].reshape(len(some), -1)
    moved = means.copy()
    moved[finite] += (after - before)[near].mean(axis=1)
    return moved
