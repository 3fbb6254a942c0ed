"""The ball's shape and where it lies. Needs numpy only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .surface import BallShape

SHAPE = BallShape()
#: Vertices per pixel of the frame's width: an edge of the mesh then projects to about half a pixel.
VERTICES_PER_PIXEL = 1.375

#: Angle between the ball's long axis and the rail, so that rings are not seen edge on.
TURN = np.radians(-14.0)


def ball_pose() -> NDArray[np.float64]:
    """[4, 4] object to Blender's world: lying on the table, long axis roughly along the rail."""
    matrix = np.eye(4)
    cosine, sine = np.cos(TURN), np.sin(TURN)
    matrix[:2, :2] = [[cosine, -sine], [sine, cosine]]
    matrix[2, 3] = SHAPE.radius - SHAPE.height / 2  # pebbles sink a little into the cloth
    return matrix


def shape_for(width: int) -> BallShape:
    """The ball with a mesh as fine as a frame of `width` px can show."""
    around = int(np.clip(round(VERTICES_PER_PIXEL * width), 48, 2200))
    return replace(SHAPE, around=around, along=max(32, round(around * SHAPE.along / SHAPE.around)))
