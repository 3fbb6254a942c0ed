"""Surfaces that a training begins with: around the cameras' points; where cameras have none, those as well.

Points for cameras that were given without any come from the photos, from the run that is resumed, or are random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import compiled
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.given import load_cameras
from ..surface.find import SurfaceSettings, surface_points
from ..surface.seeded import seeded_surface
from ..twin.folder import TwinFolder
from ..views import SparsePoints


@dataclass(frozen=True)
class RandomPointSettings:
    """Of points that nothing speaks for."""

    confidence: float = number(0.02, "confidence", "of a random point: hardly to be seen until the photos ask for it")


SETTINGS = RandomPointSettings()


def with_surface(
    given: Reconstruction,
    photos: Sequence[Photo],
    medium: Medium,
    hurried: bool,
    folder: TwinFolder,
    resumed: bool,
    progress: Progress,
) -> Reconstruction:
    """The cameras with points on the surfaces that the photos show, and a note that says where they come from.

    Args:
        given: cameras with random points.
        photos: that may be looked at; hurried: on smaller views.
        resumed: whether the folder's points are taken, if it has such.

    Raises:
        Cancelled: the user asked to stop.
    """
    kept = load_cameras(folder.camera_folder, list(photos)).points if resumed else None
    if kept is not None and kept.confidence is not None:
        progress.note("The points are those of the run that is resumed")
        random = bool((kept.confidence <= SETTINGS.confidence).all())
        return replace(given, points=kept, figures=replace(given.figures, scattered=random))
    settings = SurfaceSettings(hurried=hurried)
    found = surface_points(photos, given, medium, folder.sfm_folder, compiled.threads(), progress, settings)
    for warning in found.warnings:
        progress.note(warning)
    if len(found.points.positions) == 0:
        progress.note("The cameras came without points, and the photos show none: random ones stand where they look")
        faint = np.full(len(given.points.positions), SETTINGS.confidence, np.float32)
        return replace(given, points=replace(given.points, confidence=faint))
    progress.note(f"The cameras came without points: {found.words}")
    return replace(given, points=found.points, figures=replace(given.figures, scattered=False))


def with_samples(cameras: Reconstruction, photos: Sequence[Photo], medium: Medium, progress: Progress) -> SparsePoints:
    """The cameras' points with samples of the surfaces between them, where the photos confirm such.

    Args:
        cameras: with sparse points; photos: that may be looked at.

    Raises:
        Cancelled: the user asked to stop.
    """
    points = cameras.points
    found = seeded_surface(photos, cameras, medium, progress)
    return points if found is None else replace(points, samples=found.samples)
