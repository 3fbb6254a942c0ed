"""`--psf auto`: the point spread estimated from the photos before anything else."""

from __future__ import annotations

from dataclasses import replace

from ..imaging.psf import PointSpread
from ..inspection.blind_psf import blind_psf
from ..inspection.photo_set import PhotoSet
from ..photos.load import Photo
from .settings import ReconstructSettings


def estimated_psf(
    photos: list[Photo], settings: ReconstructSettings
) -> tuple[PointSpread | None, ReconstructSettings]:
    """The point spread, in px of the photos' files, and the settings with it in place of 'auto'.

    Raises:
        PsfError: the photos do not tell; the message says how far they do, and the way out.
    """
    found = blind_psf(PhotoSet(photos, linear=settings.blur_space == "linear"))
    psf = found.point_spread()
    if psf is None:
        return None, replace(settings, psf="none")
    # The photos in memory may have been shrunk; a point spread is given in px of the files.
    scale = photos[0].scale[0]
    if scale != 1.0:
        wide = [value / scale for value in (psf.sigma_x, psf.sigma_y)]
        source = f"gaussian:{wide[0]:.3f},{wide[1]:.3f},{psf.angle:.1f}"
        psf = replace(psf, sigma_x=wide[0], sigma_y=wide[1], source=source)
    return psf, replace(settings, psf=psf.source)
