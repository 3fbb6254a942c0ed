"""The first half of a run: cameras from photos, kept for the second."""

from __future__ import annotations

from ..files import check_writable
from ..lock import working_on
from ..machine import use_machine
from ..outputs import claim_output_folder
from ..photos.movie import is_movie
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..run_settings import RunSettings
from ..twin.begun import BegunRun
from ..twin.folder import TwinFolder
from .blind import given_spreads
from .cameras import cameras_of, search_for
from .medium import medium_of
from .photos import read_photos


def only_cameras(run: RunSettings, progress: Progress) -> Reconstruction:
    """Finds the cameras and writes them to `run.out`/cameras.

    Raises:
        DgsError: one of its subclasses; what stands in the folder is as it was then.
    """
    given = given_spreads(run.medium.psf)
    check_writable(run.out)
    claim_output_folder(run.out)
    with working_on(run.out, "cameras", progress.note):
        begun = BegunRun(TwinFolder(run.out), "anew", is_movie(run.photos.photos))
        with begun.until_finished([run.photos.photos]):
            search = search_for(run.training, use_machine(run.threads), False, False)
            loaded = read_photos(run.photos, begun.folder, progress)
            medium = medium_of(run.medium, given, loaded.photos, progress).medium
            begun.check_photos(loaded.contents, None)
            return cameras_of(None, loaded.photos, medium, search, begun.folder, progress).reconstruction
