"""The stage 'photos': the photos of a run, and which of them are kept out of the training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..photos.load import Photo, load_photos
from ..photos.source import photo_source
from ..photos.store import PhotoStore
from ..photos.uniform import before_background
from ..progress import Progress
from ..run_settings import PhotoSettings
from ..twin.begun import BegunRun
from ..twin.folder import TwinFolder
from ..views import heldout_names


@dataclass(frozen=True)
class LoadedPhotos:
    """The photos of a run.

    Attributes:
        source: folder or list that they came from; of a movie, the folder of its frames.
        photos: sorted by name; held: names of those that no training sees.
        every: one photo in so many is held out; 0 for none.
    """

    source: Path
    photos: list[Photo]
    held: list[str]
    every: int

    @property
    def contents(self) -> dict[str, str]:
        """Digests of the photos' files by name."""
        return {photo.name: photo.content for photo in self.photos}

    def finally_in(self, begun: BegunRun) -> LoadedPhotos:
        """The same, with a movie's frames where they will be when the run is finished."""
        photos = [replace(photo, path=begun.final(photo.path)) for photo in self.photos]
        return replace(self, source=begun.final(self.source), photos=photos)

    def placed(self, names: Mapping[str, object]) -> list[Photo]:
        """The photos that these names have a camera for."""
        return [photo for photo in self.photos if photo.name in names]


def read_photos(settings: PhotoSettings, folder: TwinFolder, progress: Progress) -> LoadedPhotos:
    """Reads the photos; a movie's frames are written to the folder first, and a list of photos is kept there.

    Raises:
        PhotoError: nothing there that can be used. OutputError: no room for photos on disk. Cancelled: the user asked
            to stop.
    """
    source = photo_source(settings.photos, folder.path, settings.frames, progress)
    store = None if settings.memory is None else PhotoStore(folder.path, settings.memory)
    behind = settings.background.transparent
    photos = load_photos(source, settings.max_size, progress, settings.masks, background=behind, store=store)
    if source.is_file():  # the list may say something else later, or be gone
        folder.save_photo_list([photo.path for photo in photos])
    photos = before_background(photos, settings.background, progress)
    held = heldout_names([photo.name for photo in photos], settings.holdout_every)
    return LoadedPhotos(source, photos, held, settings.holdout_every)
