"""The Gaussians of a twin as plain arrays, in the raw form that files store (3DGS PLY layout).

Needs numpy only, so that Blender's own Python can read it.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def cloud_part(cloud: GaussianCloud, rows: NDArray[np.intp] | NDArray[np.bool_]) -> GaussianCloud:
    """Some rows of a cloud: [M] indices, or [N] whether each is kept."""
    return GaussianCloud(*(array[rows] for array in _arrays(cloud)))


def finite_rows(cloud: GaussianCloud) -> NDArray[np.bool_]:
    """[N] whether all values of each Gaussian are finite."""
    kept = np.ones(len(cloud), bool)
    for array in _arrays(cloud):
        kept &= np.isfinite(array.reshape(len(cloud), -1)).all(axis=1)
    return kept


def joined(clouds: Sequence[GaussianCloud], harmonics: int = 1) -> GaussianCloud:
    """All Gaussians of at least one cloud, one cloud after the other.

    Args:
        clouds: in the same axes.
        harmonics: K of the result at least; colours of fewer harmonics get zeros behind them.
    """
    harmonics = max(harmonics, *(cloud.sh.shape[1] for cloud in clouds))
    padded = [np.pad(cloud.sh, ((0, 0), (0, harmonics - cloud.sh.shape[1]), (0, 0))) for cloud in clouds]
    return GaussianCloud(
        np.concatenate([cloud.means for cloud in clouds]),
        np.concatenate([cloud.log_scales for cloud in clouds]),
        np.concatenate([cloud.quaternions for cloud in clouds]),
        np.concatenate([cloud.opacity_logits for cloud in clouds]),
        np.concatenate(padded),
    )


def _arrays(cloud: GaussianCloud) -> tuple[NDArray[np.float32], ...]:
    return cloud.means, cloud.log_scales, cloud.quaternions, cloud.opacity_logits, cloud.sh
