"""The medium before a twin, as the settings of its scene or its own report have it."""

from __future__ import annotations

import math
from typing import Any

from ...core.errors import DgsError
from ..paths import absolute

#: Media that the engine estimates from the photos.
ESTIMATED_FROM_PHOTOS = ("auto", "auto-each")
#: Object property of a twin: the point spread of its report, in px of the photos as they are in their files.
PSF = "dgs_psf"
#: Object property of a recovered camera: its focal length in px of its photo.
FOCAL = "dgs_focal"


def psf_argument(settings: Any) -> str:
    """The medium of `scene.dgs` as the engine's `--psf` takes it.

    Raises:
        DgsError: a measured point spread function is wanted and none is chosen.
    """
    if settings.medium == "gaussian":
        return f"gaussian:{settings.sigma:g}"
    if settings.medium == "ellipse":
        return f"gaussian:{settings.sigma:g},{settings.sigma_minor:g},{math.degrees(settings.angle):g}"
    if settings.medium == "file":
        path = absolute(settings.psf_file)
        if path is None or not path.is_file():
            raise DgsError("The file of the point spread function is not there", "Choose it in step 3")
        return f"file:{path}"
    return str(settings.medium)  # none, or estimated from the photos


def psf_before(twin: Any, settings: Any) -> str:
    """What a twin is seen through: the medium of `scene.dgs`, or what was estimated of this twin's photos.

    Raises:
        DgsError: see `psf_argument`.
    """
    return str(twin.get(PSF, "none")) if settings.medium in ESTIMATED_FROM_PHOTOS else psf_argument(settings)


def photo_focal(twin: Any, camera: Any) -> float | None:
    """Focal length in px of the photos, in which the medium is given: of the scene's camera, else of the twin's first.

    None where no photo's camera is known.
    """
    cameras = [camera, *sorted((child for child in twin.children if child.type == "CAMERA"), key=lambda c: c.name)]
    focals = [thing[FOCAL] for thing in cameras if thing is not None and FOCAL in thing]
    return float(focals[0]) if focals and isinstance(focals[0], float) and focals[0] > 0.0 else None
