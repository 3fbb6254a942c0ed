"""Where cameras stand against the one in their middle, before which a standing glass is said."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...pose import Pose
from .glass import Stand


def middle_of(centres: NDArray[np.float64]) -> int:
    """Which of the cameras [V, 3] a standing glass is said before: the one nearest to the median of all centres."""
    away = centres - np.median(centres, axis=0)
    return int(np.linalg.norm(away, axis=1).argmin())


def stands_between(poses: Mapping[str, Pose]) -> dict[str, Stand]:
    """Where all cameras stand against the one in their middle."""
    first = list(poses.values())[middle_of(np.array([pose.centre for pose in poses.values()]))]
    turn, at = first.rotation, first.centre
    return {
        name: Stand(np.asarray(turn @ pose.rotation.T), np.asarray(turn @ (pose.centre - at)))
        for name, pose in poses.items()
    }
