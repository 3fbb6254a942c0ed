"""The photos of a folder as the panel shows them: how many, which look unusable, thumbnails.

Decoding is the engine's business; only the first bytes are read here, so that a panel may ask often.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

#: As in `core.photos.load`, which cannot be imported here: it needs Pillow.
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
_SIGNATURES = {
    ".png": (b"\x89PNG",), ".jpg": (b"\xff\xd8",), ".jpeg": (b"\xff\xd8",), ".tif": (b"II", b"MM"),
    ".tiff": (b"II", b"MM"), ".webp": (b"RIFF",), ".bmp": (b"BM",),
}  # fmt: skip
#: Enough of a file for a signature; enough for a JPEG's size, which lies behind its metadata.
_SIGNATURE, _METADATA = 32, 65_536


@dataclass(frozen=True)
class PhotoFolder:
    """What a folder holds.

    Attributes:
        files: the photos, by name.
        size: (width, height) in px of most of them, where their headers tell.
        warnings: a sentence for every photo that will be left out or is unlike the others.
        problem: why the folder cannot be used; '' if it can.
    """

    files: tuple[Path, ...] = ()
    size: tuple[int, int] | None = None
    warnings: tuple[str, ...] = field(default=())
    problem: str = ""


#: The folder that was looked at last, with the time of its last change.
_known: dict[Path, tuple[int, PhotoFolder]] = {}


def photo_folder(folder: Path) -> PhotoFolder:
    """Looks at a folder, or remembers what it looked like if no file has come or gone."""
    try:
        changed = folder.stat().st_mtime_ns
    except OSError:
        changed = -1
    known = _known.get(folder)
    if known is not None and known[0] == changed:
        return known[1]
    found = _look(folder)
    _known.clear()
    _known[folder] = (changed, found)
    return found


def forget() -> None:
    """Looks anew next time."""
    _known.clear()


def _look(folder: Path) -> PhotoFolder:
    try:
        files = tuple(
            sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))
        )
    except OSError as error:
        return PhotoFolder(problem=f"This folder cannot be read: {(error.strerror or str(error)).lower()}")
    if len(files) < 3:
        count = "no photos" if not files else f"only {len(files)} photo{'s' if len(files) > 1 else ''}"
        return PhotoFolder(files, problem=f"{count.capitalize()} here; at least 3 are needed, 20 or more are better")
    heads = {path: _head(path) for path in files}
    sizes = Counter(size for ok, size in heads.values() if ok and size is not None)
    usual = sizes.most_common(1)[0][0] if sizes else None
    warnings = [f"{path.name}: no photo inside, it will be left out" for path, (ok, _) in heads.items() if not ok]
    warnings += [
        f"{path.name}: {size[0]} x {size[1]} px, unlike the others"
        for path, (ok, size) in heads.items()
        if ok and size is not None and size not in (usual, usual[::-1] if usual else None)
    ]
    return PhotoFolder(files, usual, tuple(warnings))


def _head(path: Path) -> tuple[bool, tuple[int, int] | None]:
    """Whether a file begins like a picture, and its size where that is cheap to learn."""
    suffix = path.suffix.lower()
    try:
        with open(path, "rb") as stream:
            data = stream.read(_METADATA if suffix in (".jpg", ".jpeg") else _SIGNATURE)
    except OSError:
        return False, None
    if not data.startswith(_SIGNATURES[suffix]):
        return False, None
    if suffix == ".png" and len(data) >= 24:
        return True, struct.unpack(">II", data[16:24])
    if suffix in (".jpg", ".jpeg"):
        return True, _jpeg_size(data)
    return True, None


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
