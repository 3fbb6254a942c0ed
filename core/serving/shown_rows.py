"""Which of a twin's splats are shown, and how it stands: for whoever draws it. Needs numpy only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..constants import NEAR_PLANE
from .messages import Floats, PlacedTwin

Matrix = NDArray[np.float64]

#: Points that the distance of what a camera sees is estimated from, as `core.training.scale` does it.
POINTS = 2000
#: Opacities are kept inside (0, 1) by this much: their logits are finite.
LEAST_OPACITY = 1e-7


def shown_rows(means: Floats, opacity_logits: Floats, twin: PlacedTwin) -> NDArray[np.bool_]:
    """[N] whether each splat is shown: by its opacity, its number and its place in the twin's box.

    Args:
        means: [N, 3] in the twin's own axes; opacity_logits: [N].
    """
    kept = np.isfinite(means).all(axis=1)
    kept &= opacity_logits >= _logit(twin.faintest)
    count = len(means)
    if twin.most is not None and twin.most < count:
        share, index = twin.most / count, np.arange(count)
        kept &= np.floor((index + 1) * share) > np.floor(index * share)
    if twin.box is not None:
        box = matrix_of(twin.box)
        inside = means.astype(np.float64) @ box[:3, :3].T + box[:3, 3]
        kept &= (np.abs(inside) <= 1.0).all(axis=1)
    if twin.size <= 0:
        kept[:] = False
    return kept


def nearest_depth(depths: Matrix) -> float | None:
    """Nearest depth that is drawn, from the depths [M] of some points; None where nothing lies before the camera."""
    ahead = depths[depths > 0]
    return NEAR_PLANE * float(np.median(ahead)) if len(ahead) else None


def logits(opacities: Floats) -> Floats:
    """[N] of opacities [N], 0 to 1."""
    opacity = np.clip(opacities, LEAST_OPACITY, 1.0 - LEAST_OPACITY)
    return np.log(opacity / (1.0 - opacity))


def matrix_of(values: Sequence[float]) -> Matrix:
    """[4, 4] of 16 numbers."""
    return np.array(values, np.float64).reshape(4, 4)


def _logit(opacity: float) -> float:
    opacity = min(max(opacity, 0.0), 1.0)
    if opacity <= LEAST_OPACITY:
        return -np.inf
    return np.inf if opacity >= 1.0 else float(np.log(opacity / (1.0 - opacity)))
