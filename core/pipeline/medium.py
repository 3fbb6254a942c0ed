"""The stage 'medium': what blurs the photos, on the grid of the photos as used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..imaging.medium import Medium
from ..photos.load import Photo
from ..progress import Progress
from ..run_settings import MediumSettings
from .blind import Spreads, spreads_of


@dataclass(frozen=True)
class FoundMedium:
    """What blurs the photos.

    Attributes:
        spreads: point spreads in px of the photos' files.
        medium: on the grid of the photos as used.
    """

    spreads: Spreads
    medium: Medium


def medium_of(
    settings: MediumSettings, given: Spreads | None, photos: Sequence[Photo], progress: Progress
) -> FoundMedium:
    """The medium of these photos; estimated from them where that was asked for.

    Args:
        given: from `blind.given_spreads`; None to estimate.

    Raises:
        PsfError: the photos do not show their blur, or do not fit the list.
    """
    spreads = spreads_of(given, photos, settings)
    for note in spreads.notes:
        progress.note(f"The point spread function: {note}")
    return FoundMedium(spreads, medium_with(spreads, settings, photos))


def medium_with(spreads: Spreads, settings: MediumSettings, photos: Sequence[Photo]) -> Medium:
    """Point spreads on the grid of the photos as loaded (`--max-size` shrinks the blur too)."""
    scales = {photo.name: photo.scale[0] for photo in photos}
    return Medium(spreads.psf, settings.blur_space, spreads.own).at_scales(scales)
