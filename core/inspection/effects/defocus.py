"""Defocus: blur that changes with depth."""

from __future__ import annotations

from ..evidence import Evidence, judged, unknown
from ..local_blur import fit_local_blur
from ..photo_set import PhotoSet

#: Standard deviation (px) that the blurriest depth has beyond the sharpest.
SMALLEST = 1.0


def inspect(photos: PhotoSet) -> Evidence:
    """Blur of tiles against the depth of the points in them."""
    if photos.tracks is None:
        return unknown("defocus", "px", SMALLEST, f"Not measured: {photos.no_tracks}")
    local = fit_local_blur(photos)
    if local is None or not local.depth_known:
        return unknown("defocus", "px", SMALLEST, "Not measured: the scene is too flat, or too few tiles hold points")
    sharp = local.curve[0][int(local.curve[1].argmin())]
    text = f"{local.defocus:.2f} px (sigma) are added away from the sharpest depth, {sharp:.2f} of the median"
    return judged(
        "defocus", local.defocus, local.defocus_error, SMALLEST, "px", text, sharpest_depth=round(float(sharp), 3)
    )
