"""Cameras refined by the loss, between finding them and the long training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera import Camera
from ..evaluation.poses import pose_errors
from ..imaging.medium import Medium
from ..lens import MODELS, Lens
from ..photos.load import Photo
from ..photos.undistort import undistorted_views
from ..pose import Pose
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.given import load_cameras
from ..training.settings import TrainingSettings
from ..twin.refine_cameras import Refined, refine_cameras
from .cameras import FoundCameras


@dataclass(frozen=True)
class RefinementJob:
    """What cameras are refined with.

    Attributes:
        photos: those with a camera; held: names of those that judge.
        medium: on the photos' grid.
        settings: of the training; effort is not taken over.
        reference: true cameras, only for reporting errors.
    """

    photos: list[Photo]
    held: Sequence[str]
    medium: Medium
    settings: TrainingSettings
    reference: Path | None


def refine(found: FoundCameras, job: RefinementJob, progress: Progress) -> FoundCameras:
    """Poses and the shared focal length moved by the loss, if held-out photos confirm them; else as they were.

    Raises:
        Cancelled: the user asked to stop.
    """
    before = found.reconstruction
    views = undistorted_views(job.photos, before)
    refined = refine_cameras(
        [v for v in views if v.name not in job.held],
        [v for v in views if v.name in job.held],
        before.points,
        job.medium,
        job.settings,
        progress,
        focal=len(set(before.lenses.values())) == 1,
    )
    facts = refined.plain()
    if job.reference is not None:
        given = {view.name: view.camera for view in views}
        facts["error_before"] = against(given, job.reference, job.photos)
        facts["error_after"] = against(refined.cameras, job.reference, job.photos)
    if not refined.kept:
        progress.note("The cameras were refined, but held-out photos are not explained better: they stay as they were")
        return replace(found, refined=facts)
    moved = taken_over(before, refined)
    progress.note(f"The cameras were refined: they moved by {refined.moved_px:.2f} px (median)")
    return replace(found, reconstruction=moved, refined=facts)


def taken_over(reconstruction: Reconstruction, found: Refined) -> Reconstruction:
    """The reconstruction with refined poses and focal length; the same where the refinement was not kept."""
    if not found.kept:
        return reconstruction
    lenses = {name: _zoomed(lens, 1.0 + found.focal_change) for name, lens in reconstruction.lenses.items()}
    poses = {
        name: Pose(found.cameras[name].rotation, found.cameras[name].translation) if name in found.cameras else pose
        for name, pose in reconstruction.poses.items()
    }
    return replace(reconstruction, poses=poses, lenses=lenses)


def against(cameras: dict[str, Camera], reference: Path, photos: list[Photo]) -> dict[str, float | None]:
    """Median errors of cameras against a reference: px-equivalent of the centre, degrees, relative focal length.

    Raises:
        CameraError: the reference has none of these cameras.
    """
    truth = load_cameras(reference, photos)
    points = None if truth.figures.scattered else truth.points.positions
    errors = pose_errors(cameras, truth.cameras(), points)
    median = lambda values: round(float(np.median(values)), 5) if np.isfinite(values).all() else None  # noqa: E731
    return {"centre_px": median(errors.centre_px), "angle_deg": median(errors.angle), "focal": median(errors.focal)}


def _zoomed(lens: Lens, factor: float) -> Lens:
    head = 1 if MODELS[lens.model][0] else 2
    return replace(lens, params=(*(f * factor for f in lens.params[:head]), *lens.params[head:]))
