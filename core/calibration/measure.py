"""From a calibration photo to a measured point spread: recognises what was photographed and measures it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy import ndimage

from ..errors import PsfError
from ..files import replacing
from ..numbers import BY_DEFINITION, number
from .edge import measure_edge
from .light import Light, read_light
from .measured import Kind, MeasuredPsf
from .point import background_of, measure_point


@dataclass(frozen=True)
class KindSettings:
    """How a point of light and an edge are distinguished."""

    largest_point: float = number(
        0.05, "share of the photo", "a bright region that covers more, with a flat top, is a surface and no point"
    )
    flat_top: float = number(
        0.5,
        "share",
        "of the region above half height that lies above nine tenths: 0.15 for a Gaussian, 1 for a flat top",
        BY_DEFINITION,
    )
    minimum_height: float = number(
        8.0, "standard deviations of the smoothed noise", "by which something must stand out to be measured"
    )
    smallest_photo: int = number(24, "px", "shortest side of a photo that can be measured")


SETTINGS = KindSettings()


def measure_psf(photo: Path, kind: Literal["auto", "point", "edge"] = "auto", linear: bool = True) -> MeasuredPsf:
    """Measures the point spread.

    Args:
        photo: a point of light or a slanted edge, through the medium.
        kind: which of them; 'auto' decides by the bright region's shape.
        linear: measure on linear light (physics), or on the values as they stand.

    Raises:
        PhotoError: the photo cannot be read.
        PsfError: there is nothing to measure; the message says the way out.
    """
    light = read_light(photo, linear)
    if min(light.values.shape) < SETTINGS.smallest_photo:
        raise PsfError(
            f"The photo '{light.name}' is too small to measure",
            f"Give at least {SETTINGS.smallest_photo} x {SETTINGS.smallest_photo} px",
        )
    if kind == "auto":
        kind = which_kind(light)
    return measure_point(light) if kind == "point" else measure_edge(light)


def which_kind(light: Light) -> Kind:
    """'edge' where the bright region reaches the photo's border or is large and flat, else 'point'."""
    smooth = ndimage.gaussian_filter(light.values, 1.5)
    level, noise = background_of(smooth)
    peak = float(smooth.max())
    low = float(np.quantile(smooth, 0.02))
    if peak - low < SETTINGS.minimum_height * max(noise, 0.1 * light.step):
        raise PsfError(
            f"Neither a point of light nor an edge stands out in '{light.name}'",
            "Photograph a point of light in the dark, or a straight edge between black and white",
        )
    # Twice: of the whole range, and above the background (a dim point beside a dim gradient).
    bright = smooth > 0.5 * (low + peak)
    labels, _ = ndimage.label(bright)
    region = labels == labels.flat[int(np.argmax(smooth))]
    border = np.concatenate([region[0], region[-1], region[:, 0], region[:, -1]])
    if border.any():
        return "edge"
    top = float((region & (smooth > low + 0.9 * (peak - low))).sum()) / float(region.sum())
    return "edge" if region.mean() > SETTINGS.largest_point and top > SETTINGS.flat_top else "point"


def write_kernel(path: Path, measured: MeasuredPsf) -> None:
    """Writes the kernel as `--psf file:PATH` reads it: float32 TIFF, or NPY by the suffix.

    Raises:
        PsfError: the suffix is neither; OutputError: it cannot be written.
    """
    if path.suffix.lower() not in (".tif", ".tiff", ".npy"):
        raise PsfError(f"A kernel cannot be written as '{path.name}'", "Give a name that ends in .tif or .npy")
    with replacing(path) as temporary:
        if path.suffix.lower() == ".npy":
            np.save(temporary, measured.kernel)
        else:
            import tifffile  # late: only for TIFF files

            tifffile.imwrite(temporary, measured.kernel.astype(np.float32))
