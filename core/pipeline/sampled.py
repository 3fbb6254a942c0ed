"""The stages 'photos' and 'medium' for a few of the photos: enough to say what all of them would take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import Cancelled, PhotoError, PsfError
from ..imaging.medium import Medium
from ..photos.load import Photo, load_photo, photo_files
from ..photos.movie import is_movie
from ..photos.uniform import before_background
from ..progress import Progress
from ..run_settings import MediumSettings, PhotoSettings
from .blind import Spreads, given_spreads, spreads_of
from .medium import medium_with


@dataclass(frozen=True)
class SampledPhotos:
    """A few of the photos.

    Attributes:
        files: all of them; photos: the few; medium: on their grid.
    """

    files: list[Path]
    photos: list[Photo]
    medium: Medium


def sample_photos(
    settings: PhotoSettings, blur: MediumSettings, pick: Callable[[Sequence[Path]], list[Path]], progress: Progress
) -> SampledPhotos:
    """Reads the photos that `pick` chooses, and what blurs them.

    Raises:
        PhotoError, PsfError: the photos or the medium cannot be used. Cancelled: the user asked to stop.
    """
    given = given_spreads(blur.psf)
    if is_movie(settings.photos) and not settings.photos.is_dir():
        raise PhotoError(
            f"'{settings.photos.name}' is a movie: its frames have to be chosen first",
            "Run 'cameras' on it once, then give OUT/frames",
        )
    files = photo_files(settings.photos)
    few = pick(files)
    progress.stage("photos", len(few))
    photos = []
    for index, file in enumerate(few):
        if progress.cancelled():
            raise Cancelled("Stopped while reading photos")
        photos.append(load_photo(file, settings.max_size, settings.background.transparent))
        progress.advance(index + 1)
    photos = before_background(photos, settings.background, progress)
    spreads = _spreads(given, photos, blur, progress)
    return SampledPhotos(files, photos, medium_with(spreads, blur, photos))


def _spreads(given: Spreads | None, photos: list[Photo], blur: MediumSettings, progress: Progress) -> Spreads:
    """What was given, or the blur that a few photos show; a run looks at all of them."""
    try:
        return spreads_of(given, photos, blur, some=True)
    except PsfError:
        if given is not None:
            raise
        progress.note("A few photos do not show the blur: estimated without any, so a run takes longer")
        return Spreads(None)
