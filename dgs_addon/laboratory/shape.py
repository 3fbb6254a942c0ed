"""The ball's shape and where it lies. Needs numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surface import BallShape

SHAPE = BallShape()
#: Angle between the ball's long axis and the rail, so that rings are not seen edge on.
TURN = np.radians(-14.0)


def ball_pose() -> NDArray[np.float64]:
    """[4, 4] object to Blender's world: lying on the table, long axis roughly along the rail."""
    matrix = np.eye(4)
    cosine, sine = np.cos(TURN), np.sin(TURN)
    matrix[:2, :2] = [[cosine, -sine], [sine, cosine]]
    matrix[2, 3] = SHAPE.radius - SHAPE.height / 2  # pebbles sink a little into the cloth
    return matrix
