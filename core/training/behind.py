"""What stands behind the twin: the photos' background, or their mean colour; and where photos show nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..background import Background
from ..numbers import number
from ..photos.empty import empty_pixels
from ..views import View

Planes = NDArray[np.float32]


@dataclass(frozen=True)
class BehindSettings:
    """How many photos are asked where all would take too long."""

    photos: int = number(12, "photos", "whose colours are averaged, evenly over the set; more say little new")


SETTINGS = BehindSettings()


def without_empty(planes: Planes, view: View, step: int) -> Planes:
    """A photo's planes [3, h, w] on a grid of `step` px, NaN where any px of the photo shows nothing."""
    empty = empty_pixels(view)
    if empty is None or not empty.any():
        return planes
    _, height, width = planes.shape
    blocks = empty[: height * step, : width * step].reshape(height, step, width, step)
    return np.where(blocks.any(axis=(1, 3)), np.float32(np.nan), planes)


def background_of(views: Sequence[View]) -> Background | None:
    """What is known to be behind what the photos show."""
    return next((view.background for view in views if view.background is not None), None)


def colour_behind(views: Sequence[View]) -> torch.Tensor:
    """[3] float32 sRGB: what stands behind the twin: the photos' background, or where that is not known, their mean."""
    known = background_of(views)
    return mean_colour(views) if known is None else torch.tensor(known.colour)


def mean_colour(views: Sequence[View]) -> torch.Tensor:
    """[3] float32 sRGB: the photos' mean, which stands behind the twin and in what no photo shows."""
    sums = np.zeros(3)
    for view in views[:: max(1, len(views) // SETTINGS.photos)]:
        full = float(np.iinfo(view.photo.dtype).max)
        pixels = view.photo if view.mask is None or not view.mask.any() else view.photo[view.mask]
        # (channel by channel: numpy is slow along an axis of three)
        sums += [pixels[..., c].mean() / full for c in range(3)]
    return torch.from_numpy(sums / len(views[:: max(1, len(views) // SETTINGS.photos)])).float()
