"""Cameras for an inspection: given, found from the photos, or none."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ..errors import CameraError, Cancelled
from ..imaging.psf import PointSpread
from ..progress import Progress
from ..sfm.find import find_cameras
from ..sfm.given import load_cameras
from ..sfm.settings import SfmSettings
from .photo_set import PhotoSet

#: Blur (px) from which on it is undone before features are sought.
UNDONE = 1.2


def with_cameras(photos: PhotoSet, given: Path | None, threads: int, progress: Progress) -> PhotoSet:
    """The set with cameras: `given` ones, or found from the photos.

    Where none can be found the set comes back without, and says why; a camera file that cannot be used is an error.

    Raises:
        FormatError, CameraError: of the given camera file.
        Cancelled: the user asked to stop.
    """
    if given is not None:
        return _replaced(photos, given=load_cameras(given, list(photos.photos)))
    sigma = photos.sigma
    kernel = PointSpread(sigma_x=sigma, sigma_y=sigma).kernel() if sigma > UNDONE else None
    try:
        with tempfile.TemporaryDirectory(prefix="dgs-inspect-") as work:
            wanted = SfmSettings(threads=threads).hurried()
            found = find_cameras(list(photos.photos), kernel, wanted, Path(work), progress)
    except Cancelled:
        raise
    except CameraError as error:
        progress.note(f"Without cameras: {error}")
        photos.why = f"no cameras were found ({error.what})"
        return photos
    return _replaced(photos, given=found)


def _replaced(photos: PhotoSet, given: object) -> PhotoSet:
    photos.cameras = given  # type: ignore[assignment]
    return photos
