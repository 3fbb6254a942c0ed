"""Point spreads of a run: given, listed photo by photo, or estimated from the photos before anything else."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .. import json_shape
from ..errors import PsfError
from ..files import read_json
from ..imaging.psf import PointSpread
from ..imaging.psf_text import KERNEL_SUFFIXES, parse_psf
from ..inspection.blind_psf import blind_psf
from ..inspection.photo_set import PhotoSet
from ..inspection.psf_per_photo import gaussian_text, psf_per_photo
from ..photos.load import Photo
from ..run_settings import MediumSettings

#: Words that ask for an estimate.
ESTIMATED = ("auto", "auto-each")
#: What a list of point spreads begins with, and its entry for photos that it does not name.
LISTED, OTHERS = "per-photo:", "*"


@dataclass(frozen=True)
class Spreads:
    """Point spreads in px of the photos' files.

    Attributes:
        psf: of every photo that has none of its own.
        own: by photo name.
        notes: sentences for the user.
    """

    psf: PointSpread | None
    own: Mapping[str, PointSpread | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @staticmethod
    def alike(psf: PointSpread | None) -> Spreads:
        """The same for all photos."""
        return Spreads(psf, notes=() if psf is None else psf.notes)

    @property
    def source(self) -> str:
        """The shared one as `parse_psf` reads it."""
        return "none" if self.psf is None else self.psf.source


def given_spreads(text: str) -> Spreads | None:
    """What `--psf` says without the photos; None where they are asked (auto, auto-each).

    Raises:
        PsfError: the text, the list or a kernel's file makes no sense.
    """
    if text in ESTIMATED:
        return None
    if text.startswith(LISTED):
        return _listed(Path(text.removeprefix(LISTED)))
    return Spreads.alike(parse_psf(text))


def spreads_of(given: Spreads | None, photos: Sequence[Photo], settings: MediumSettings, some: bool = False) -> Spreads:
    """The point spreads of these photos.

    Args:
        given: from `given_spreads`.
        some: the photos are a few of the set, so that a list may name others.

    Raises:
        PsfError: the photos do not show it, or do not fit the list; the message says the way out.
    """
    if given is None:
        return _estimated(photos, settings)
    if settings.psf.startswith(LISTED):
        return _of_photos(given, photos, settings.psf.removeprefix(LISTED), some)
    return given


def _listed(file: Path) -> Spreads:
    try:
        content = read_json(file)
    except OSError as error:
        raise PsfError(f"The list of point spreads '{file}' cannot be read", "Check the path given") from error
    except ValueError as error:
        raise PsfError(f"The list of point spreads '{file}' is no JSON ({error})", _example()) from error
    try:
        json_shape.check_shape(content, {"*": json_shape.text})
    except ValueError as error:
        raise PsfError(f"The list of point spreads '{file}' is no object of texts ({error})", _example()) from error
    if not content:
        raise PsfError(f"The list of point spreads '{file}' is empty", _example())
    own: dict[str, PointSpread | None] = {}
    for name, text in content.items():
        try:
            own[unicodedata.normalize("NFC", name)] = parse_psf(_beside(file, text))
        except PsfError as error:
            raise PsfError(f"In '{file}', '{name}': {error.what}", error.way_out) from error
    notes = [f"'{name}': {note}" for name, psf in own.items() if psf is not None for note in psf.notes]
    shared = own[OTHERS] if OTHERS in own else _middle(list(own.values()))
    return Spreads(shared, own, tuple(notes))


def _of_photos(listed: Spreads, photos: Sequence[Photo], file: str, some: bool) -> Spreads:
    """The list for these photos: everyone is in it, and nobody else."""
    names = {photo.name for photo in photos}
    strangers = sorted(set(listed.own) - names - {OTHERS})
    if strangers and not some:
        raise PsfError(
            f"The list of point spreads '{file}' names '{strangers[0]}', which is no photo of the set",
            f"Write the photos' file names as they are, and '{OTHERS}' for all others",
        )
    missing = sorted(names - set(listed.own))
    if missing and OTHERS not in listed.own:
        raise PsfError(
            f"The list of point spreads '{file}' says nothing of '{missing[0]}'"
            + (f" and {len(missing) - 1} more photos" if len(missing) > 1 else ""),
            f"Add them, or '{OTHERS}' for all others",
        )
    own = {name: psf for name, psf in listed.own.items() if name in names}
    return replace(listed, own=own, notes=(*listed.notes, f"{len(own)} photos have one of their own ({file})"))


def _estimated(photos: Sequence[Photo], settings: MediumSettings) -> Spreads:
    linear = settings.blur_space == "linear"
    source = PhotoSet(photos, linear=linear)
    found = blind_psf(source)
    moved = _motion_seen(source, settings)
    if moved and settings.motion_apart and found.verdict == "upper bound":
        # (a guess would take for blur that all share what their paths are tried for)
        return Spreads(None, notes=(found.text, moved))
    try:
        shared = found.point_spread()
    except PsfError as error:
        if settings.decided:
            return Spreads(None, notes=(f"{found.text}; none is taken", *([moved] if moved else [])))
        if not moved:
            raise
        raise PsfError(f"{error.what}. {moved[0].upper()}{moved[1:]}", error.way_out) from error
    if shared is None:
        alone = (f"{found.text}, so no photo gets a Gaussian of its own",) if settings.psf == "auto-each" else ()
        return Spreads(None, notes=(*(alone or (found.text,)), *([moved] if moved else [])))
    # The photos in memory may have been shrunk; a point spread is given in px of the files.
    scale = {photo.name: photo.scale[0] for photo in photos}
    first = _in_files(shared, photos[0].scale[0])
    notes = (*shared.notes, *([moved] if moved else []))
    if settings.psf != "auto-each":
        return Spreads(first, notes=notes)
    paths = source.motion_paths.items() if settings.motion_apart else ()
    own = psf_per_photo(photos, shared, linear, {name: path.length for name, path in paths})
    spreads = {name: _in_files(psf, scale[name]) for name, psf in own.spreads.items()}
    return Spreads(first, spreads, (*notes, own.text))


def _motion_seen(source: PhotoSet, settings: MediumSettings) -> str:
    """What the photos show of motion, and what takes it into account; empty where none is clear."""
    if source.motion is None or not source.motion.significant:
        return ""
    scale = {photo.name: photo.scale[0] for photo in source.photos}
    lengths = [path.length / scale[name] for name, path in source.motion_paths.items() if path.length]
    seen = (
        f"{len(lengths)} of {len(source.photos)} photos moved while the shutter was open, by paths of "
        f"{min(lengths):.1f} to {max(lengths):.1f} px: a Gaussian does not describe that blur"
    )
    way = "--effects auto (where a short trial confirms them) or --effects motion learns each photo's path"
    if settings.motion_apart:
        way = "--effects decides whether each photo's path is learned"
    return f"{seen}; {way}"


def _in_files(psf: PointSpread, scale: float) -> PointSpread:
    if scale == 1.0:
        return psf
    x, y = psf.sigma_x / scale, psf.sigma_y / scale
    return replace(psf, sigma_x=x, sigma_y=y, source=gaussian_text(x, y, psf.angle))


def _middle(spreads: list[PointSpread | None]) -> PointSpread | None:
    """The one of middle width: what stands for all where only one can."""
    widths = [0.0 if psf is None else float(np.trace(psf.covariance)) for psf in spreads]
    return spreads[int(np.argsort(widths, kind="stable")[len(widths) // 2])]


def _beside(file: Path, text: str) -> str:
    """Kernels' paths count from the list's folder."""
    kind, mark, rest = text.partition(":")
    path = Path(rest if kind == "file" and mark else text)
    if path.is_absolute() or (kind != "file" and path.suffix.lower() not in KERNEL_SUFFIXES):
        return text
    return f"file:{(file.parent / path).resolve()}"


def _example() -> str:
    return 'Write {"photo.png": "gaussian:3", "other.png": "kernel.tif", "*": "gaussian:2"}'
