"""The chosen photos (a folder, some of its files, or a movie) as the panel shows them: how many, which look unusable.

Decoding is the engine's business; only the first bytes are read here, so that a panel may ask often.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bpy.app.translations import pgettext_rpt as rpt_

from ..core.photos.kinds import HEIF, MOVIES, left_out, read_suffixes

#: How a file of each kind begins.
_SIGNATURES = {
    ".png": (b"\x89PNG",),
    ".jpg": (b"\xff\xd8",),
    ".jpeg": (b"\xff\xd8",),
    ".tif": (b"II", b"MM"),
    ".tiff": (b"II", b"MM"),
    ".webp": (b"RIFF",),
    ".bmp": (b"BM",),
    **dict.fromkeys(HEIF, (b"ftyp",)),
}
#: Where the signature stands; at the beginning if it is not here.
_PLACE = dict.fromkeys(HEIF, 4)
#: Enough of a file for a signature; enough for a JPEG's size, which lies behind its metadata.
_SIGNATURE, _METADATA = 32, 65_536
#: Enough of a PNG for what stands before its pixels: a palette has 768 bytes.
_PNG_TABLES = 2048


@dataclass(frozen=True)
class PhotoFolder:
    """What a folder holds, or the chosen part of it.

    Attributes:
        files: the photos, by name, as far as they begin like pictures; none of a movie.
        size: (width, height) in px of most of them, where their headers say.
        warnings: a sentence for every photo that will be left out or is unlike the others.
        problem: why the folder cannot be used; '' if it can.
        movie: the movie that the photos are taken from, or None.
        with_alpha: how many photos (PNG) have an alpha channel.
    """

    files: tuple[Path, ...] = ()
    size: tuple[int, int] | None = None
    warnings: tuple[str, ...] = field(default=())
    problem: str = ""
    movie: Path | None = None
    with_alpha: int = 0


#: Whether the engine reads HEIC: asked of those who know where the engine is.
_engine_reads_heif: list[Callable[[], bool]] = []
#: The folder or movie that was read last, with the time of its last change.
_cache: dict[tuple[Path, str], tuple[int, PhotoFolder]] = {}


def ask_about_heif(engine_reads_heif: Callable[[], bool]) -> None:
    """Sets the function that says whether the engine reads HEIC; until then it counts as unable to."""
    _engine_reads_heif[:] = [engine_reads_heif]
    forget()


def suffixes() -> frozenset[str]:
    """Endings of the photos that the engine reads."""
    return read_suffixes(_heif())


def _heif() -> bool:
    return any(ask() for ask in _engine_reads_heif)


def is_movie(path: Path) -> bool:
    """Whether a path names a movie, by its ending."""
    return path.suffix.lower() in MOVIES and not path.is_dir()


def photo_folder(folder: Path, selection: str = "") -> PhotoFolder:
    """Lists the photos of a folder or movie, or remembers what was in it if no file has come or gone.

    Args:
        folder: with photos; or a movie.
        selection: names of the photos that count, one a line; all if empty.
    """
    try:
        changed = folder.stat().st_mtime_ns
    except OSError:
        changed = -1
    key = (folder, selection)
    cached = _cache.get(key)
    if cached is not None and cached[0] == changed:
        return cached[1]
    found = _look_at_movie(folder) if is_movie(folder) else _look(folder, selection)
    _cache.clear()
    _cache[key] = (changed, found)
    return found


def forget() -> None:
    """Empties the cache, so that the next question reads the folder anew."""
    _cache.clear()


def _look_at_movie(path: Path) -> PhotoFolder:
    try:
        with open(path, "rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return PhotoFolder(problem=rpt_("This movie cannot be read: {reason}").format(reason=reason), movie=path)
    return PhotoFolder(problem=rpt_("This movie is empty") if empty else "", movie=path)


def _look(folder: Path, selection: str) -> PhotoFolder:
    wanted, kinds = set(selection.splitlines()), suffixes()
    try:
        there = sorted(p for p in folder.iterdir() if not p.name.startswith(".") and (not wanted or p.name in wanted))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return PhotoFolder(problem=rpt_("This folder cannot be read: {reason}").format(reason=reason))
    heads = {path: _head(path) for path in there if path.suffix.lower() in kinds}
    files = tuple(path for path, (ok, _) in heads.items() if ok)
    unread = _unread([path.name for path in there])
    damaged = [
        rpt_("{name}: no photo inside, it will be left out").format(name=path.name)
        for path, (ok, _) in heads.items()
        if not ok
    ]
    if len(files) < 3:
        words = (
            rpt_("No photos here; at least 3 are needed, 20 or more are better"),
            rpt_("Only 1 photo here; at least 3 are needed, 20 or more are better"),
            rpt_("Only 2 photos here; at least 3 are needed, 20 or more are better"),
        )
        return PhotoFolder(files, problem=". ".join([words[len(files)], *[*damaged, *unread][:1]]))
    sizes = Counter(size for ok, size in heads.values() if ok and size is not None)
    usual = sizes.most_common(1)[0][0] if sizes else None
    gone = sorted(wanted - {path.name for path in heads})
    warnings = [rpt_("{name}: it is not there any more").format(name=name) for name in gone]
    warnings += [*unread, *damaged]
    warnings += [
        rpt_("{name}: {width} x {height} px, unlike the others").format(name=path.name, width=size[0], height=size[1])
        for path, (ok, size) in heads.items()
        if ok and size is not None and size not in (usual, usual[::-1] if usual else None)
    ]
    return PhotoFolder(files, usual, tuple(warnings), with_alpha=sum(_has_alpha(path) for path in files))


def _unread(names: list[str]) -> list[str]:
    """A sentence for every picture of a kind that the engine does not read."""
    words = rpt_("{name}: pictures of this kind are not read, it will be left out")
    heif = rpt_("{name}: HEIC needs the package pillow-heif in the engine's Python, it will be left out")
    return [
        (heif if Path(name).suffix.lower() in HEIF else words).format(name=name) for name in left_out(names, _heif())
    ]


def _head(path: Path) -> tuple[bool, tuple[int, int] | None]:
    """Whether a file begins like a picture, and its size where that is cheap to learn."""
    suffix = path.suffix.lower()
    try:
        with open(path, "rb") as stream:
            data = stream.read(_METADATA if suffix in (".jpg", ".jpeg") else _SIGNATURE)
    except OSError:
        return False, None
    if not data[_PLACE.get(suffix, 0) :].startswith(_SIGNATURES[suffix]):
        return False, None
    if suffix == ".png" and len(data) >= 24:
        return True, struct.unpack(">II", data[16:24])
    if suffix in (".jpg", ".jpeg"):
        return True, _jpeg_size(data)
    return True, None


def _has_alpha(path: Path) -> bool:
    """Whether a PNG has an alpha channel, or a colour of its palette that is transparent."""
    if path.suffix.lower() != ".png":
        return False
    try:
        with open(path, "rb") as stream:
            data = stream.read(_PNG_TABLES)
    except OSError:
        return False
    return len(data) > 25 and (data[25] in (4, 6) or b"tRNS" in data.partition(b"IDAT")[0])


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """From the first start-of-frame segment; None if it lies behind large metadata."""
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        kind, length = data[place + 1], int.from_bytes(data[place + 2 : place + 4], "big")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            return width, height
        place += 2 + length
    return None
