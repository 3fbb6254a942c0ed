"""The medium's point spread from a photo."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

from ..core.calibration.measure import measure_psf as measure
from ..core.calibration.measured import MeasuredPsf
from ..core.files import write_bytes
from .arrays import Picture, tiff_bytes


def measure_psf(
    photo: Path | str | Picture, kind: Literal["auto", "point", "edge"] = "auto", linear: bool = True
) -> MeasuredPsf:
    """Measures what the medium does to a point of light, or to a slanted edge (ISO 12233).

    Args:
        photo: a file, or the photo as an array [H, W, 3] or [H, W] (uint8, uint16 or floats in [0, 1], sRGB-encoded).
        kind: what was photographed.
        linear: undo the sRGB curve first, for `blur_space='linear'`; else measure on the values as they stand.

    Returns:
        `kernel` [K, K] float64 with sum 1, and its widths in px with their uncertainty.

    Raises:
        PhotoError: no such photo. PsfError: there is nothing to measure.
    """
    if isinstance(photo, (str, Path)):
        return measure(Path(photo), kind, linear)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "photo.tif"
        write_bytes(file, tiff_bytes(photo, "the photo"))
        return measure(file, kind, linear)
