"""The stage 'cameras': where the photos were taken from; given, those of the run that is resumed, or found."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import CameraError
from ..files import make_folder
from ..imaging.medium import Medium
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..run_settings import TrainingRequest
from ..sfm.find import find_cameras
from ..sfm.given import load_cameras
from ..sfm.settings import SfmSettings
from ..training.settings import TrainingSettings
from ..twin.folder import TwinFolder
from .surface import with_surface
from .world import near_origin


@dataclass(frozen=True)
class FoundCameras:
    """Cameras, and where they come from.

    Attributes:
        reconstruction: poses, lenses and points.
        source: 'given' by the user, or 'sfm' where they were found from the photos.
        file: what the user gave, or None.
        refined: what moving them by the loss found, for report.json; None where it was not asked for.
        surface_seconds: of the time that the cameras took, what points for those that came without any took.
    """

    reconstruction: Reconstruction
    source: str
    file: Path | None = None
    refined: Mapping[str, Any] | None = None
    surface_seconds: float = 0.0


@dataclass(frozen=True)
class CameraSearch:
    """How cameras are found.

    Attributes:
        settings: of structure from motion.
        resume: take those in the folder, if there are.
        sh_degree: of the training: its kernels become ready meanwhile; None where nothing is to become ready.
        refined: those in the folder were refined since: they count even where the user gave some.
        hurried: points of cameras that came without any are found in a hurry.
        held: names of photos that show no surface to a run that is scored on them.
    """

    settings: SfmSettings
    resume: bool
    sh_degree: int | None = None
    refined: bool = False
    hurried: bool = False
    held: frozenset[str] = frozenset()


def search_for(request: TrainingRequest, threads: int, hurried: bool, resume: bool) -> CameraSearch:
    """How a run that trains so looks for its cameras: a draft is always in a hurry."""
    preset = TrainingSettings.preset(request.preset).sh_degree
    degree = preset if request.sh_degree is None else request.sh_degree
    usual = SfmSettings(threads=threads)
    settings = usual.hurried() if hurried or request.preset == "draft" else usual
    return CameraSearch(settings, resume, degree)


def cameras_of(
    given: FoundCameras | None,
    photos: list[Photo],
    medium: Medium,
    search: CameraSearch,
    folder: TwinFolder,
    progress: Progress,
) -> FoundCameras:
    """Cameras of the photos, kept in the folder.

    Args:
        given: by the user; None to find the cameras. Where they came without points, the photos give some.

    Raises:
        CameraError: no trustworthy cameras, or fewer than two.
        OutputError: they cannot be written.
    """
    resumed = search.resume and folder.camera_folder.is_dir()
    if not resumed:  # (of an earlier twin in this folder)
        folder.features.unlink(missing_ok=True)
    if given is not None:
        found = given
        if resumed and search.refined:
            moved, figures = load_cameras(folder.camera_folder, photos), given.reconstruction.figures
            figures = replace(moved.figures, from_photos=figures.from_photos)  # (what is kept does not say it)
            found = replace(given, reconstruction=replace(moved, figures=figures))
        elif given.reconstruction.figures.scattered:
            seen = [photo for photo in photos if photo.name not in search.held]
            began = time.perf_counter()
            known = with_surface(given.reconstruction, seen, medium, search.hurried, folder, resumed, progress)
            found = replace(given, reconstruction=known, surface_seconds=time.perf_counter() - began)
    elif resumed:
        kept = folder.found_cameras if folder.found_cameras.is_dir() else folder.camera_folder
        found = FoundCameras(load_cameras(kept, photos), "sfm")
        progress.note("The cameras are those of the run that is resumed")
    else:
        found = FoundCameras(_found(photos, medium, search, folder, progress), "sfm")
    count = len(found.reconstruction.poses)
    if count < 2:
        raise CameraError(
            f"Only {count} of {len(photos)} photos have a camera",
            "Check that the names in the camera model are those of the photos",
        )
    folder.save_cameras(found.reconstruction)
    return found


def given_cameras(path: Path, photos: list[Photo], progress: Progress) -> Reconstruction:
    """Cameras that the user has, moved to the origin where they lie too far from it.

    Args:
        path: COLMAP model folder or transforms.json.

    Raises:
        FormatError: unreadable, or not a camera file. CameraError: it has no camera for these photos.
    """
    reconstruction, offset = near_origin(load_cameras(path, photos))
    if offset is not None:
        progress.note(
            "The cameras lie too far from their origin for files of float32: cameras and twin were moved; "
            f"add ({', '.join(f'{value:g}' for value in offset)}) to return to the world that was given"
        )
    return reconstruction


def _found(
    photos: Sequence[Photo], medium: Medium, search: CameraSearch, folder: TwinFolder, progress: Progress
) -> Reconstruction:
    """From the photos. The child works on one core half of the time: meanwhile this process gets its kernels ready."""
    from ..training.warmup import compile_kernels  # heavy: numba

    kernel = None if medium.psf is None or medium.psf.is_identity else medium.psf.kernel()
    degrees = () if search.sh_degree is None else (search.sh_degree,)
    early = threading.Thread(target=compile_kernels, args=degrees)
    if degrees:
        early.start()
    work = make_folder(folder.sfm_folder)
    found = find_cameras(list(photos), kernel, search.settings, work, progress, folder.features)
    if degrees:
        early.join()
    return found
