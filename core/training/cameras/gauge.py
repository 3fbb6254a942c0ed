"""The world's place, turn and size after cameras and points were adjusted together: as the first cameras see it.

An adjustment leaves a similarity free. Laid by the cameras' centres, what was adjusted is off where it counts: cameras
that all turn a little towards the scene's middle keep their centres and see all of it larger. Whoever looks from
cameras of the first world that took no part (views kept for a comparison, an animation, another photo) would see the
twin beside its place. So the world is laid where the first cameras see the adjusted points as nearly as may be where
the adjusted cameras see them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ...camera import Camera
from ...evaluation.poses import Similarity
from ...numbers import BY_DEFINITION, number
from .bundle import Adjusted, Floats, Observations, by_local, turned_by


@dataclass(frozen=True)
class GaugeSettings:
    """Of the similarity that lays what was adjusted into the first cameras' world."""

    iterations: int = number(10, "count", "steps of Gauss and Newton, with new weights each time", BY_DEFINITION)
    outlier: float = number(
        1.0,
        "typical distances",
        "cameras that were far off at first say little of where the world is (Geman and McClure's weights)",
        "held-out views of the shaken ball from cameras as COLMAP found them: 26.47, 26.41, 26.12, 25.70 dB by a half,"
        " 1, 2, and squares",
        "a weakly shaken shelf and a plant: by a half, 1 and 2 the same but for 0.07 dB (twins made once, laid anew by"
        " each)",
    )


SETTINGS = GaugeSettings()


def as_first_seen(
    first: Sequence[Camera], found: Adjusted, seen: Observations, settings: GaugeSettings = SETTINGS
) -> Similarity:
    """The similarity from the adjusted world to the first one.

    Args:
        first: cameras as they were at first, in the order of `found.cameras`.
        seen: which camera sees which point; where is not asked.
    """
    local, length = _before(found.cameras, seen, found.points)
    aim = local[:, :2] / local[:, 2:] * length[:, None]
    middle = found.points.mean(axis=0)
    spread = max(float(np.linalg.norm(found.points - middle, axis=1).mean()), 1e-12)
    scale, turn, shift = 1.0, np.eye(3), np.zeros(3)
    for _ in range(settings.iterations):
        turned = scale * (found.points - middle) @ turn.T
        columns, rest = _equations(first, seen, turned, middle + shift, aim)
        off = np.linalg.norm(rest, axis=1)
        typical = max(1.4826 * float(np.median(off)), 1e-9)
        weight = 1.0 / (1.0 + (off / (settings.outlier * typical)) ** 2) ** 2
        columns[:, :, 3:6] *= spread
        matrix = np.einsum("k,kac,kad->cd", weight, columns, columns)
        move = np.linalg.lstsq(matrix, np.einsum("k,kac,ka->c", weight, columns, rest), rcond=1e-12)[0]
        turn = Rotation.from_rotvec(move[:3]).as_matrix() @ turn
        shift, scale = shift + move[3:6] * spread, scale * float(np.exp(move[6]))
    return Similarity(scale, turn, middle + shift - scale * turn @ middle, 3)


def _before(cameras: Sequence[Camera], seen: Observations, points: Floats) -> tuple[Floats, Floats]:
    """[K, 3] the points before the cameras that see them, and [K] focal lengths."""
    turned, placed = np.stack([c.rotation for c in cameras]), np.stack([c.translation for c in cameras])
    local = np.einsum("kab,kb->ka", turned[seen.camera], points[seen.point]) + placed[seen.camera]
    return local, np.array([c.fx for c in cameras])[seen.camera]


def _equations(
    first: Sequence[Camera], seen: Observations, turned: Floats, middle: Floats, aim: Floats
) -> tuple[Floats, Floats]:
    """Derivatives [K, 2, 7] of what the first cameras see in a turn, a shift and the size of the world, and what is
    missing [K, 2] to where the points are to be seen."""
    local, length = _before(first, seen, turned + middle)
    z = np.where(local[:, 2:] > 0, local[:, 2:], np.inf)
    behind = ~np.isfinite(z[:, 0])
    rest = np.where(behind[:, None], 0.0, aim - local[:, :2] / z * length[:, None])
    by_world = (
        by_local(np.where(behind[:, None], 1.0, local), length) @ np.stack([c.rotation for c in first])[seen.camera]
    )
    by_world[behind] = 0.0
    about = turned[seen.point]
    columns = [by_world @ turned_by(about), by_world, by_world @ about[..., None]]
    return np.concatenate(columns, axis=2), rest
