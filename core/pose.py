"""Where a camera stands and looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pose:
    """World to camera: x_camera = rotation @ x_world + translation (COLMAP axes).

    Attributes:
        rotation: [3, 3] float64, orthonormal, determinant 1.
        translation: [3] float64, world units.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    @property
    def centre(self) -> NDArray[np.float64]:
        """Position in the world, [3]."""
        return -self.rotation.T @ self.translation
