"""Which files are photos and which are movies, by their endings; Blender's own Python reads this file too."""

from __future__ import annotations

from pathlib import Path

#: Photos that are always read.
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp"})
#: Read where the package pillow-heif is there.
HEIF = frozenset({".heic", ".heif"})
#: The package's folder in Python's library.
HEIF_PACKAGE = "pillow_heif"
#: Pictures of kinds that are not read; somebody may take them for photos.
UNREAD = frozenset({".gif", ".avif", ".jp2", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".exr"})
MOVIES = frozenset({".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mts", ".m2ts", ".ogv"})


def read_suffixes(heif: bool) -> frozenset[str]:
    """Endings of photos that are read, where pillow-heif is there or not."""
    return SUFFIXES | HEIF if heif else SUFFIXES


def left_out(names: list[str], heif: bool) -> list[str]:
    """Those that are pictures of kinds that are not read; hidden files are none."""
    kinds = (UNREAD | HEIF) - read_suffixes(heif)
    return sorted(name for name in names if Path(name).suffix.lower() in kinds and not name.startswith("."))
