"""Cameras refined by the loss, between finding them and the long training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..imaging.medium import Medium
from ..lens import MODELS, Lens
from ..photos.load import Photo
from ..pose import Pose
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..run_settings import ReconstructSettings
from ..twin.refine_cameras import Refined


def refined(
    settings: ReconstructSettings,
    reconstruction: Reconstruction,
    photos: list[Photo],
    held: list[str],
    medium: Medium,
    threads: int,
    device: str,
    progress: Progress,
) -> tuple[Reconstruction, dict[str, Any]]:
    """Refines poses and the shared focal length, and writes them to `settings.out`/cameras if they are kept.

    Returns:
        The cameras to go on with, and what is said of them in report.json ('cameras', 'refined').
    """
    from ..formats.colmap import write_lenses
    from ..photos.undistort import undistorted_views
    from ..training.settings import TrainingSettings
    from ..twin.refine_cameras import refine_cameras

    views = undistorted_views([photo for photo in photos if photo.name in reconstruction.poses], reconstruction)
    chosen = replace(
        TrainingSettings.preset(settings.preset), loss=settings.loss, seed=settings.seed, threads=threads, device=device
    )
    one_lens = len(set(reconstruction.lenses.values())) == 1
    found = refine_cameras(
        [v for v in views if v.name not in held],
        [v for v in views if v.name in held],
        reconstruction.points,
        medium,
        chosen,
        progress,
        focal=one_lens,
    )
    facts = found.plain()
    if settings.reference_cameras is not None:
        given = {view.name: view.camera for view in views}
        facts["error_before"] = against(given, settings.reference_cameras, photos)
        facts["error_after"] = against(found.cameras, settings.reference_cameras, photos)
    if not found.kept:
        progress.note("The cameras were refined, but held-out photos are not explained better: they stay as they were")
        return reconstruction, facts
    moved = taken_over(reconstruction, found)
    write_lenses(settings.out / "cameras", moved.lenses, moved.poses, moved.points)
    progress.note(f"The cameras were refined: they moved by {found.moved_px:.2f} px (median)")
    return moved, facts


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
    from ..evaluation.poses import pose_errors
    from ..sfm.given import load_cameras

    truth = load_cameras(reference, photos)
    points = None if truth.figures.scattered else truth.points.positions
    errors = pose_errors(cameras, truth.cameras(), points)
    median = lambda values: round(float(np.median(values)), 5) if np.isfinite(values).all() else None  # noqa: E731
    return {"centre_px": median(errors.centre_px), "angle_deg": median(errors.angle), "focal": median(errors.focal)}


def _zoomed(lens: Lens, factor: float) -> Lens:
    head = 1 if MODELS[lens.model][0] else 2
    return replace(lens, params=(*(f * factor for f in lens.params[:head]), *lens.params[head:]))
