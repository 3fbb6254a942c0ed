"""How many photos look at the same side of things: they average its noise, and tell what is seen from what is invented.

Photos that go all round an object are many; each of its sides is seen by some of them only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numbers import number
from ...views import SparsePoints, View, first_copies


@dataclass(frozen=True)
class OverlapSettings:
    """Which photos are taken to look at the same side of a place."""

    angle: float = number(
        60.0,
        "degrees",
        "between two photos' directions to a place, up to which they may see the same side of it: a surface is seen up"
        " to about so far from its normal",
        "judgement; no other value was tried",
        "against the number of all photos, sharp held-out views behind blurs of 3 px: plant +0.17 dB, lego +0.13;"
        " copr (5 px, one side) +0.01. Where photos that do not have the place in their frame were left out, too, copr"
        " lost 0.2 dB and banana 0.1",
    )
    cameras: int = number(16, "cameras", "evenly over the set, whose places are asked")
    points: int = number(400, "points", "of the scene that are asked")


SETTINGS = OverlapSettings()


def photos_of_one_side(views: Sequence[View], points: SparsePoints, settings: OverlapSettings = SETTINGS) -> int:
    """Median over the places that photos show, of how many distinct photos look at them from about the same side.

    What hides what, and where frames end, is not asked.

    Returns:
        In [1, distinct photos]; the number of distinct photos where no point is in any frame.
    """
    cameras = [view.camera for view in first_copies(views)]
    positions = points.positions[:: max(1, len(points.positions) // settings.points)]
    towards = np.stack([_unit(camera.centre - positions) for camera in cameras])  # [V, M, 3]
    nearest = np.cos(np.radians(settings.angle))
    counts = []
    for i in np.unique(np.linspace(0, len(cameras) - 1, settings.cameras).astype(int)):
        mine = cameras[i].in_frame(positions)
        counts.append((np.einsum("vmc,mc->vm", towards[:, mine], towards[i, mine]) >= nearest).sum(axis=0))
    found = np.concatenate(counts)
    return round(float(np.median(found))) if len(found) else len(cameras)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """[..., 3] of length 1 (0 where it is 0)."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
