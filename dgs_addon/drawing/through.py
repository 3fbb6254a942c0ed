"""The medium before the twins of a scene, as a picture of any size needs it."""

from __future__ import annotations

from typing import Any

from ...core.camera import Camera
from ...core.serving.messages import Blur
from ..scene.medium import photo_focal, psf_before
from ..scene.twin import scene_twin

#: Scene property: whether pictures are seen through the medium.
THROUGH = "dgs_through"


def blur_before(scene: Any, camera: Camera, back: float) -> Blur | None:
    """What blurs a picture of a scene; None where nothing does.

    A blur in px of the photos is as wide in a picture as its focal length says; one without perspective has none.

    Args:
        camera: of the picture; back: how far it was set back because it has no perspective (0 if it has).

    Raises:
        DgsError: the medium's file is not there.
    """
    twin = scene_twin(scene, None)
    if twin is None:
        return None
    psf = psf_before(twin, scene.dgs)
    focal = photo_focal(twin, scene.camera) if back == 0.0 else None
    return None if psf == "none" else Blur(psf, scene.dgs.blur_space, 1.0 if focal is None else focal / camera.fx)
