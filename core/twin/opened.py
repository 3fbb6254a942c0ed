"""Opens the folder that `reconstruct` left behind: photos, cameras, medium and Gaussians of one twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..errors import FormatError
from ..formats.ply import read_ply
from ..forward import Exposure, FixedMedium, ForwardModel, low_pass_on_grid, margin_for, shared_medium, space_of
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.formation.exposure import Exposure as PhotoExposure
from ..imaging.medium import BlurSpace, Medium
from ..imaging.psf_text import parse_psf
from ..photos.load import Photo, load_photos
from ..photos.source import photo_source
from ..photos.undistort import undistorted_views
from ..photos.uniform import before_background
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..reconstruction import Reconstruction
from ..run_settings import ReconstructSettings, RunSettings
from ..sfm.given import load_cameras
from ..training.behind import colour_behind
from ..training.grid import GridView, grid_step
from ..training.scale import SceneScale, scene_scale
from ..views import View, heldout_names
from .exposures import learned_exposure, without_exposure
from .folder import TwinFolder


@dataclass(frozen=True)
class OpenedTwin:
    """One twin with everything it was made from.

    Attributes:
        folder: where it lies.
        settings: of the run that made it.
        photos: all photos; reconstruction: cameras of those that have one.
        medium: on the grid of the photos as loaded.
        views: undistorted photos with cameras, held-out ones too.
        held: names that were kept out of the training.
        gaussians: in world units, drawn with the usual low-pass.
        scale: the scene's own units.
        background: [3] sRGB colour behind the twin.
        exposure: of the photos that it was trained on, undone on their views; None where none was learned.
    """

    folder: Path
    settings: RunSettings
    photos: list[Photo]
    reconstruction: Reconstruction
    medium: Medium
    views: list[View]
    held: list[str]
    gaussians: Gaussians
    scale: SceneScale
    background: Tensor
    exposure: PhotoExposure | None = None

    @property
    def kept(self) -> list[View]:
        """The views it was trained on."""
        return [view for view in self.views if view.name not in self.held]

    @property
    def step(self) -> int:
        """Photo px per grid px that the blur allows."""
        camera = self.views[0].camera
        return grid_step(self.medium, camera.width, camera.height)

    def on_grid(self, views: list[View], step: int) -> list[GridView]:
        """Views in the scene's own units on a grid of `step` photo px."""
        return [
            GridView(v, self.scale.camera_to_unit(v.camera), step, self.medium.psf_for(v.name), self.medium.blur_space)
            for v in views
        ]

    def margin(self, step: int) -> int:
        """Grid px that a render must be larger on every side, so that light from beyond the border is there."""
        spreads = [self.medium.psf, *self.medium.per_view.values()]
        widest = max(
            (
                0.0 if p is None or p.is_identity else float(np.linalg.eigvalsh(p.covariance)[-1]) ** 0.5
                for p in spreads
            ),
            default=0.0,
        )
        return margin_for(widest, step)

    def model(self, margin: int | None = None, blur_space: BlurSpace | None = None) -> ForwardModel:
        """From the twin to its photos, on the grid of `step`; `expose` takes views of `on_grid`.

        Args:
            margin: grid px around each photo; None for what the blur asks for.
            blur_space: another than the medium's.
        """
        around, space = self.margin(self.step) if margin is None else margin, blur_space or space_of(self.medium)

        def medium(view: Exposure) -> FixedMedium:
            return shared_medium(view.psf, Frame(view.camera.height, view.camera.width, around), space)

        return ForwardModel(self.raster_settings(), medium, around)

    def raster_settings(self) -> RasterSettings:
        """How the twin is drawn on the grid of `step`: with the low-pass that viewers have on the photos' own grid."""
        return RasterSettings(low_pass=low_pass_on_grid(self.step))


def settings_of(folder: TwinFolder, report: Mapping[str, Any], photos: Path | None = None) -> RunSettings:
    """The settings of the run that made a twin; its cameras are those in the folder."""
    settings = ReconstructSettings.from_plain(report["settings"]["run"])
    listed = folder.photo_list  # what updates added is in it too
    given = photos or (listed if listed.is_file() else settings.photos)
    return replace(settings, out=folder.path, cameras=folder.camera_folder, photos=given).split()


@dataclass(frozen=True)
class StoredTwin:
    """What is read from a twin's folder before anything is computed; the fields are those of `OpenedTwin`."""

    folder: Path
    settings: RunSettings
    photos: list[Photo]
    reconstruction: Reconstruction
    medium: Medium
    held: list[str]
    gaussians: Gaussians
    exposure: PhotoExposure | None = None

    def twin(self) -> OpenedTwin:
        """The twin; undistorting its photos takes most of the time."""
        placed = self.reconstruction.poses
        filed = undistorted_views([photo for photo in self.photos if photo.name in placed], self.reconstruction)
        views = without_exposure(filed, self.exposure)
        scale = scene_scale([view.camera for view in views], self.reconstruction.points)
        shown = [view for view in views if view.name not in self.held] or views
        return OpenedTwin(
            self.folder,
            self.settings,
            self.photos,
            self.reconstruction,
            self.medium,
            views,
            self.held,
            self.gaussians,
            scale,
            colour_behind(shown).to(torch.float32),
            self.exposure,
        )


def open_twin(folder: Path, progress: Progress, photos: Path | None = None) -> OpenedTwin:
    """Reads a twin folder.

    Args:
        folder: what `reconstruct --out` named.
        photos: where its photos lie now, if they were moved.

    Raises:
        FormatError: no twin folder, or damaged. PhotoError, CameraError: as of `reconstruct`.
    """
    return open_files(folder, progress, photos).twin()


def open_files(folder: Path, progress: Progress, photos: Path | None = None) -> StoredTwin:
    """The first, quick part of `open_twin`."""
    kept = TwinFolder(folder)
    report = kept.report()
    settings = settings_of(kept, report, photos)
    exposure = learned_exposure(report)
    cloud = read_ply(kept.twin_file)
    psf = parse_psf(settings.medium.psf)
    source = photo_source(settings.photos.photos, folder, settings.photos.frames, progress)
    asked = settings.photos.background
    loaded = load_photos(
        source, settings.photos.max_size, progress, settings.photos.masks, background=asked.transparent
    )
    loaded = before_background(loaded, asked, progress)
    listed = {name: parse_psf(text) for name, text in (report.get("medium", {}).get("per_photo") or {}).items()}
    medium = Medium(psf, settings.medium.blur_space, listed).at_scales({p.name: p.scale[0] for p in loaded})
    noted = kept.update_log()
    own = {name: parse_psf(text) for name, text in noted.get("psf", {}).items()}
    medium = replace(medium, per_view={**medium.per_view, **own})
    if not kept.camera_folder.is_dir():
        raise FormatError(f"'{folder}' is no whole twin folder: it lacks cameras/", "Reconstruct the twin again")
    reconstruction = load_cameras(kept.camera_folder, loaded)
    held = noted.get("held") or heldout_names([photo.name for photo in loaded], settings.photos.holdout_every)
    return StoredTwin(folder, settings, loaded, reconstruction, medium, held, Gaussians.from_cloud(cloud), exposure)
