"""The first half of a run: cameras from photos, kept for the second."""

from __future__ import annotations

from ..files import check_writable
from ..machine import use_threads
from ..photos.load import load_photos
from ..photos.source import photo_source
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..run_settings import ReconstructSettings
from .blind import spreads_of, told_spreads
from .reconstruct import cameras_of, medium_for


def only_cameras(settings: ReconstructSettings, progress: Progress) -> Reconstruction:
    """Finds the cameras and writes them to `settings.out`/cameras.

    Raises:
        DgsError: one of its subclasses; nothing was written then.
    """
    told = told_spreads(settings.psf)
    check_writable(settings.out)
    threads = use_threads(settings.threads)
    source = photo_source(settings.photos, settings.out, settings.frames, progress)
    photos = load_photos(source, settings.max_size, progress, settings.masks)
    spreads, settings = spreads_of(told, photos, settings)
    medium = medium_for(photos, spreads.psf, settings, spreads.own)
    reconstruction, _ = cameras_of(settings, photos, medium, threads, progress)
    return reconstruction
