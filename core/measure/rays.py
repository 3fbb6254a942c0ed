"""Lines of sight: from px of a photo into the scene, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera

Array = NDArray[np.float64]


def ray(camera: Camera, x: float, y: float) -> Array:
    """[3] world direction of a point of a photo, of depth 1."""
    return np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]) @ camera.rotation


def projected(camera: Camera, position: Array) -> tuple[float, float]:
    """Where a position lies in the photo, px; NaN behind the camera."""
    x, y = camera.projected(position[None])[0][0]
    return float(x), float(y)


def inside(camera: Camera, x: float, y: float) -> bool:
    """Whether a point lies on the photo."""
    return 0 <= x < camera.width and 0 <= y < camera.height
