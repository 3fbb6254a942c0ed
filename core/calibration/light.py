"""A calibration photo as one plane of light, with what is saturated in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..colour import srgb_to_linear
from ..numbers import number
from ..photos.load import load_photo

Array = NDArray[np.float64]

#: The pixel's own square footprint has this variance (px^2) along every direction; it is no part of the medium.
PIXEL_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True)
class LightSettings:
    """Of the light in a photo."""

    saturated_steps: int = number(
        2,
        "rounding steps of the file",
        "below its largest value that still count as saturated: demosaicking and JPEG move it a little",
    )


SETTINGS = LightSettings()


@dataclass(frozen=True)
class Light:
    """One plane of a photo.

    Attributes:
        name: the file's name.
        values: [H, W] float64, mean of the channels; linear light, or the values as they stand.
        saturated: [H, W] bool, any channel at the top of its range.
        linear: whether the sRGB curve was undone.
        step: the file's rounding step in [0, 1] (before the curve).
    """

    name: str
    values: Array = field(repr=False)
    saturated: NDArray[np.bool_] = field(repr=False)
    linear: bool
    step: float

    @property
    def space(self) -> str:
        """What `values` are, in the words of `--blur-space`."""
        return "linear" if self.linear else "srgb"


def read_light(path: Path, linear: bool = True) -> Light:
    """Reads a photo of any kind that `load_photo` reads.

    Args:
        path: the photo.
        linear: undo the sRGB curve; False takes the values as they stand (for a medium that is to blur
            sRGB values, or a file that holds linear light already).

    Raises:
        PhotoError: the file cannot be read.
    """
    photo = load_photo(path, background=None)
    top = int(np.iinfo(photo.pixels.dtype).max)
    unit = photo.pixels.astype(np.float64) / top
    values = srgb_to_linear(unit) if linear else unit
    saturated = (photo.pixels >= top - SETTINGS.saturated_steps).any(axis=2)
    return Light(photo.name, np.asarray(values.mean(axis=2)), saturated, linear, 1.0 / top)
