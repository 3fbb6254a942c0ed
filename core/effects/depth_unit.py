"""The unit of depth in which a training renders, seen from the observations of points."""

from __future__ import annotations

from ..inspection.photo_set import PhotoSet
from ..training.scale import scene_scale


def depth_unit(photos: PhotoSet) -> float | None:
    """Depths of the observations times this are in the unit of a render's depth; None without observations."""
    if photos.observations is None or photos.cameras is None:
        return None
    cameras = list(photos.cameras.cameras().values())
    return photos.observations.median_depth / scene_scale(cameras, photos.cameras.points).size
