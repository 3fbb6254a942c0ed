"""Features of photos, the blur undone first; starts the child that looks for them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import CameraError
from ..files import explaining
from ..photos.load import Photo
from ..progress import Progress
from .features import FEATURES, Features, load_features
from .find import talk
from .job import ONLY_FEATURES, write_job
from .settings import SfmSettings


def find_features(
    photos: Sequence[Photo], kernel: NDArray[np.float64] | None, settings: SfmSettings, progress: Progress
) -> dict[str, Features]:
    """The largest features of each photo, by its name.

    Args:
        photos: masked px give no features; kernel: as of `find.find_cameras`.

    Raises:
        CameraError: the child took too long. NativeCrash: it ended unexpectedly. Cancelled: the user asked to stop.
        OutputError: no room for the scratch folder.
    """
    with tempfile.TemporaryDirectory(prefix="dgs-features-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        names = write_job(list(photos), kernel, settings, folder)
        with explaining(folder):
            (folder / ONLY_FEATURES).touch()
        talk(folder, len(photos), settings, progress)
        found = load_features(folder / FEATURES)
    if found is None:
        raise CameraError("The features of the photos could not be read", "Try again")
    return {names[image]: one for image, one in found[0].items()}
