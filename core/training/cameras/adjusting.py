"""Cameras of shaken photos, moved to where the twin says that they were, all together.

Steps of single paths see the twin as it is, and it lies where the cameras were first thought to be: what bends both
alike is never undone. A bundle adjustment moves all cameras and the surface at once, by what each photo shows beside
the twin; the Gaussians go along with the surface, and the training goes on. Cameras that were given stay, unless the
photos contradict them: most of them were found in the same shaken photos, by another program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...camera import Camera
from ...numbers import number
from .bundle import AdjustmentSettings, Floats, adjusted, aligned_camera, contradiction
from .gauge import as_first_seen
from .twin_tracks import Sighting, lifted, observed, tracks_through

#: Which cameras are adjusted: none; those that were given, if photos contradict them; those that were found in photos.
Adjust = Literal["never", "contradicted", "always"]
#: What the numbers were chosen on, one or two seeds; docs/real_blur.md has the figures.
_SHAKEN = "24 photos of the rendered ball and 30 of the village, shaken (Cycles), cameras found"
#: What nothing else was compared with.
_FIRST = "a first choice"


@dataclass(frozen=True)
class AdjustingSettings:
    """When cameras are adjusted, and how far."""

    shares: tuple[float, ...] = number(
        (0.3, 0.45, 0.6, 0.75, 0.9),
        "shares of the run",
        "at which all cameras are adjusted: each time the twin says more. From a tenth on it says too little",
        f"{_SHAKEN}: from 0.1 on the village lost 1.0 dB, three times in all 0.2 (other weights, single runs)",
        "a shelf of 20 photos: cameras' errors halved, 29.62 -> 29.93 dB",
    )
    doubt: float = number(
        4.5,
        "times chance",
        "by which photos must be explained better by other cameras, for cameras that were given to be moved: looked at"
        " once, when the first of these adjustments is due",
        "ball and shelf, two seeds, orrery, true cameras: 0.3 to 1.7; the ball's cameras as structure from motion found"
        " them: 6.6, 10.2; the shelf's, which gain 0.3 dB by it: 0.6, 0.8; copr's true ones, shaken along a twin:"
        " above 3 in two runs of three",
        "true cameras of the village 0.5, of brighton 0.3; those that come with `tea` (real), which neither gains nor"
        " loses: 4.8",
    )
    prior: float = number(
        2.0,
        "px of the grid",
        "standard deviation of how far a camera is moved at a time: what bends all cameras shows so faintly that"
        " without it the twin's own errors would bend them",
        f"{_SHAKEN}: 1 px, with half the weight on the photos, gains nothing in the village",
        "a drawn scene of 112 px: 10 px trebles the cameras' errors",
    )
    together: float = number(
        10.0,
        "observations",
        "that count as one: windows of 13 px lie 4 px apart, so that so many see the same",
        "(13 / 4)^2",
    )
    farthest: float = number(
        0.1,
        "of the photo's diagonal",
        "that any camera is moved at a time; beyond, nothing is: the twin is no guide",
        _FIRST,
    )
    most_px: int = number(
        60_000_000,
        "px of the grid",
        "of all photos together, beyond which cameras stay: 16 bytes of each are held",
        _FIRST,
    )
    opaque: float = number(0.5, "opacity", "above which a px shows a surface", _FIRST)
    unseen_visits: int = number(2, "visits", "of a held-out photo, to find its path before it is looked at", _FIRST)
    unseen_rounds: int = number(2, "times", "that a held-out photo's camera is placed before the finished twin", _FIRST)
    unseen_fewest: int = number(20, "points", "that a held-out photo must show to be placed by them", _FIRST)


SETTINGS = AdjustingSettings()


@dataclass(frozen=True)
class Moved:
    """Where cameras stand, fitted ones and then those of held-out photos, and points [M, 3] of the surface."""

    cameras: list[Camera]
    before: Floats
    after: Floats


def due(share: float, settings: AdjustingSettings = SETTINGS) -> int:
    """How many adjustments belong to a share in [0, 1] of the run."""
    return sum(share >= at for at in settings.shares)


def contradicted(
    fitted: Sequence[Sighting], random: np.random.Generator, settings: AdjustingSettings = SETTINGS
) -> bool:
    """Whether photos contradict the cameras beyond chance and beyond what the twin, half trained, errs by itself."""
    tracks = tracks_through(fitted, random) if len(fitted) > 1 else None
    if tracks is None:
        return False
    cameras = [sighting.camera for sighting in fitted]
    found = adjusted(cameras, *tracks, False, _numbers(settings))
    return contradiction(cameras, *tracks, found, _numbers(settings)) >= settings.doubt


def adjusted_cameras(
    fitted: Sequence[Sighting],
    unseen: Sequence[Sighting],
    first: Sequence[Camera],
    random: np.random.Generator,
    settings: AdjustingSettings = SETTINGS,
) -> Moved | None:
    """Moves all cameras, and those of photos that are held out to where the moved surface is seen by them.

    The world keeps its place, turn and size: as the cameras `first` of the fitted photos, before any adjustment, see
    it. Held-out photos move nothing but their own cameras. None where photos show too little, or too much is asked of
    the cameras.
    """
    tracks = tracks_through(fitted, random) if len(fitted) > 1 else None
    if tracks is None:
        return None
    surface, seen = tracks
    before = [sighting.camera for sighting in fitted]
    found = adjusted(before, surface, seen, False, _numbers(settings))
    still = as_first_seen(first, found, seen)
    cameras, points = [still.camera(camera) for camera in found.cameras], still.points(found.points)
    cameras += [_placed(sighting, surface, points, settings) for sighting in unseen]
    pairs = zip([*fitted, *unseen], cameras, strict=True)
    if any(_moved_px(old.camera, new, points) > _farthest(new, settings) for old, new in pairs):
        return None
    return Moved(cameras, surface, points)


def placed_camera(sighting: Sighting, settings: AdjustingSettings = SETTINGS) -> Camera:
    """Where a camera stands before the surface as it is; where it stood, if its photo shows too little."""
    surface = lifted(sighting)
    return _placed(sighting, surface, surface, settings)


def _placed(sighting: Sighting, before: Floats, after: Floats, settings: AdjustingSettings) -> Camera:
    """A camera whose photo sees points that moved, both [M, 3]."""
    own = observed(before, [sighting])
    if len(own) < settings.unseen_fewest:
        return sighting.camera
    return aligned_camera(sighting.camera, after[own.point], own.position, own.error, _numbers(settings))


def _numbers(settings: AdjustingSettings) -> AdjustmentSettings:
    return AdjustmentSettings(camera_prior=settings.prior, observations_per_fact=settings.together)


def _farthest(camera: Camera, settings: AdjustingSettings) -> float:
    return settings.farthest * float(np.hypot(camera.width, camera.height))


def _moved_px(before: Camera, after: Camera, points: Floats) -> float:
    """px, median over what is in front of the camera, by which points are seen elsewhere than before."""
    seen = []
    for camera in (before, after):
        local = points @ camera.rotation.T + camera.translation
        z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
        at = local[:, :2] / z[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        inside = (at > 0).all(axis=1) & (at < (camera.width, camera.height)).all(axis=1)
        seen.append(np.where(inside[:, None], at, np.nan))
    off = np.linalg.norm(seen[1] - seen[0], axis=1)
    return float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
