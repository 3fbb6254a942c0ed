"""The Gaussians of a twin as plain arrays, in the raw form that files store (3DGS PLY layout).

Needs numpy only, so that Blender's own Python can read it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class GaussianCloud:
    """Gaussians as numpy arrays, for files and scenes (float32; needs no torch to read).

    Attributes:
        means: [N, 3] centres in world units.
        log_scales: [N, 3] natural logarithm of the standard deviations.
        quaternions: [N, 4] w x y z, not necessarily normalised.
        opacity_logits: [N] inverse sigmoid of the opacity.
        sh: [N, K, 3] spherical harmonics, K in {1, 4, 9, 16}; colour = SH + 0.5, sRGB-encoded.
    """

    means: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    opacity_logits: NDArray[np.float32]
    sh: NDArray[np.float32]

    def __len__(self) -> int:
        return int(self.means.shape[0])
