"""Worlds far from their origin: UTM coordinates do not fit the float32 of twins and of Blender."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..pose import Pose
from ..reconstruction import Reconstruction

#: Farther from the origin than this many times the spread of cameras and points, float32 numbers lie more than
#: 6e-5 of the spread apart: about a tenth of a px.
FARTHEST = 1000.0


def near_origin(reconstruction: Reconstruction) -> tuple[Reconstruction, NDArray[np.float64] | None]:
    """Moves cameras and points to the origin if they lie too far from it for float32.

    Returns:
        The reconstruction, and the offset [3] that was taken away: world = moved + offset. Itself and None
        where nothing had to be moved.
    """
    centres = np.array([pose.centre for pose in reconstruction.poses.values()])
    places = np.concatenate([centres, reconstruction.points.positions])
    middle = np.median(places, axis=0)
    spread = float(np.median(np.linalg.norm(places - middle, axis=1)))
    if not spread > 0.0 or float(np.abs(middle).max()) <= FARTHEST * spread:
        return reconstruction, None
    # A round figure is easier to add again: whole hundreds of the spread's decade.
    step = 100.0 * 10.0 ** np.floor(np.log10(spread))
    offset = np.round(middle / step) * step
    poses = {
        name: Pose(pose.rotation, pose.translation + pose.rotation @ offset)
        for name, pose in reconstruction.poses.items()
    }
    points = replace(reconstruction.points, positions=reconstruction.points.positions - offset)
    x, y, z = (float(value) for value in offset)
    figures = replace(reconstruction.figures, offset=(x, y, z))
    return replace(reconstruction, poses=poses, points=points, figures=figures), offset
