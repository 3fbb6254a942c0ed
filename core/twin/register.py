"""Cameras of new photos in the world of a twin."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from ..camera import Camera
from ..errors import CameraError
from ..evaluation.poses import align_similarity
from ..forward.compare import counted, mask_of
from ..photos.load import Photo
from ..photos.undistort import undistorted_views
from ..pose import Pose
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.find import find_cameras
from ..sfm.given import load_cameras
from ..sfm.settings import SfmSettings
from ..training.cameras.pose_steps import photometric_step, twisted
from ..training.grid import GridView
from .opened import OpenedTwin
from .placing import SETTINGS, Placing, shared_lens

#: Old photos that show how well the twin fits where a camera is right, and how many times worse a new one may fit
#: before its camera is doubted; MINIMUM_DIFFERENCE: half an 8-bit step, below which no difference counts.
CHECKED, WORSE, MINIMUM_DIFFERENCE = 6, 4.0, 0.5 / 255.0
#: Steps of the loss at the frozen twin after that, from smoothed photos (grid px) to sharp ones.
SMOOTH = (4.0, 2.0, 1.0, 0.0, 0.0)


def register(
    twin: OpenedTwin,
    photos: list[Photo],
    cameras: Path | None,
    threads: int,
    progress: Progress,
    keep: Path,
    placing: Placing | None = None,
) -> tuple[Reconstruction, bool]:
    """Cameras of new photos, and whether they are exact (else the twin itself, through the blur, should correct them).

    Given ones are taken as they are (in the twin's world). Others find their place by matches with old photos, whose
    features lie on the twin's surface. Where one does not, structure from motion runs on the new photos and some of
    the old ones, and its world is aligned with the twin's by the old ones' cameras.

    Args:
        keep: file for the features of the twin's and the new photos; scratch is made beside it, and goes.

    Raises:
        CameraError: no new photo could be placed.
    """
    if cameras is not None:
        return load_cameras(cameras, photos), True
    placed_at = against_twin(twin, photos, threads, progress, keep, placing)
    if placed_at is not None:
        return placed_at, True
    old = [photo for photo in twin.photos if photo.name in twin.reconstruction.poses]
    chosen = [old[round(i)] for i in np.linspace(0, len(old) - 1, min(SETTINGS.photos, len(old)))]
    psf = twin.medium.psf
    kernel = None if psf is None or psf.is_identity else psf.kernel()
    found = find_cameras([*chosen, *photos], kernel, SfmSettings(threads=threads), keep.parent, progress)
    before = {photo.name: twin.reconstruction.cameras()[photo.name] for photo in chosen}
    placed = found.cameras()
    both = {name: camera for name, camera in placed.items() if name in before}
    if len(both) < 3:
        raise CameraError(
            "The new photos could not be tied to the twin: too few of its own photos were placed with them",
            "Take photos that overlap the old ones, or give their cameras with --cameras",
        )
    similarity = align_similarity(both, before)
    lens = shared_lens(twin.reconstruction)
    poses: dict[str, Pose] = {}
    for photo in photos:
        if photo.name not in placed:
            continue
        camera = similarity.camera(placed[photo.name])
        if lens is not None and (lens.width, lens.height) == photo.size:
            camera = replace(camera, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy)
        poses[photo.name] = Pose(camera.rotation, camera.translation)
    if not poses:
        raise CameraError("None of the new photos could be placed", "Take photos that overlap the old ones")
    sizes = {photo.name: photo.size for photo in photos}
    lenses = {n: lens if lens is not None and (lens.width, lens.height) == sizes[n] else found.lenses[n] for n in poses}
    return replace(found, poses=poses, lenses=lenses, points=twin.reconstruction.points), False


def against_twin(
    twin: OpenedTwin, photos: list[Photo], threads: int, progress: Progress, keep: Path, placing: Placing | None = None
) -> Reconstruction | None:
    """Cameras of new photos from their matches with old ones, whose features lie on the twin's surface.

    Much quicker than structure from motion, and quicker still with the features that it kept; None where a photo
    did not find its place, is not what the twin shows there, or has a lens of its own.

    Args:
        keep: file for the features of the twin's and the new photos.
        placing: a search that has begun; None to begin one.
    """
    lens = shared_lens(twin.reconstruction)
    if lens is None or any(photo.size != (lens.width, lens.height) for photo in photos):
        return None
    usual = _usual(twin)
    progress.stage("cameras", len(photos))
    for kept in (True, False):
        search = placing if kept and placing is not None else Placing.begin(twin, photos, threads, kept=kept)
        if search is None:
            continue
        try:
            poses = search.poses(twin, keep, progress)
        finally:
            search.end()
        if poses is None:
            continue
        found = replace(twin.reconstruction, poses=poses, lenses=dict.fromkeys(poses, lens))
        seen = twin.on_grid(undistorted_views(photos, found), twin.step)
        if max(_misfit(twin, view) for view in seen) <= WORSE * usual:
            return found
    return None


def _usual(twin: OpenedTwin) -> float:
    """How well the twin fits photos whose cameras are right."""
    old = twin.views[:: max(1, len(twin.views) // CHECKED)]
    return float(np.median([_misfit(twin, view) for view in twin.on_grid(old, twin.step)]))


def _misfit(twin: OpenedTwin, view: GridView) -> float:
    """Median difference (sRGB) between a photo and the twin through the blur: a part that changed hardly counts."""
    with torch.no_grad():
        exposed = twin.model().expose(twin.scale.to_unit(twin.gaussians), view, twin.background)
        difference = exposed.residual(torch.from_numpy(view.planes())).abs()
    return max(float(counted(difference, mask_of(view.valid)).median()), MINIMUM_DIFFERENCE)


def corrected(twin: OpenedTwin, reconstruction: Reconstruction, photos: list[Photo]) -> Reconstruction:
    """New cameras moved to where the twin, through the blur, explains their photos best."""
    # sRGB values are blurred whatever the medium's space is. Nothing says why; it is kept: changing it changes results.
    gaussians, model = twin.scale.to_unit(twin.gaussians), twin.model(blur_space="srgb")
    poses = dict(reconstruction.poses)
    views = undistorted_views([photo for photo in photos if photo.name in poses], reconstruction)
    for view in twin.on_grid(views, twin.step):

        def look(camera: Camera, view: GridView = view) -> torch.Tensor:
            return model.expose(gaussians, view.seen_by(camera), twin.background).degraded

        photo, valid = torch.from_numpy(view.planes()), mask_of(view.valid)
        camera, best, least = view.camera, view.camera, np.inf
        for smooth in (*SMOOTH, None):
            with torch.no_grad():
                error = (look(camera) - photo).square()
            left = float(counted(error, valid).median())
            if left < least:
                best, least = camera, left
            if smooth is not None:
                camera = twisted(camera, photometric_step(camera, photo, valid, look, smooth))
        translation = best.translation * twin.scale.size - best.rotation @ twin.scale.origin
        poses[view.name] = Pose(best.rotation, translation)
    return replace(reconstruction, poses=poses)
