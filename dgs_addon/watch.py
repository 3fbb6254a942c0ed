"""A folder that is watched for new photos. Knows no Blender."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from .photos import SUFFIXES


@dataclass
class Watch:
    """What was seen in a folder. A photo is ready when it has not changed between two looks: cameras and
    cloud folders write in pieces.

    Attributes:
        folder: that is watched.
        taken: names that were handed out, or belonged to the twin from the start.
    """

    folder: Path
    taken: set[str] = field(default_factory=set)
    _seen: dict[str, tuple[int, int]] = field(default_factory=dict)

    def new(self) -> list[Path]:
        """Photos that were not handed out, by name, complete or not."""
        return [self.folder / name for name in sorted(self._sizes())]

    def _sizes(self) -> dict[str, tuple[int, int]]:
        now: dict[str, tuple[int, int]] = {}
        try:
            for path in self.folder.iterdir():
                if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.name not in self.taken:
                    status = path.stat()
                    now[path.name] = (status.st_size, status.st_mtime_ns)
        except OSError:  # the folder is gone for a while, or a file of it
            return {}
        return now

    def look(self) -> list[Path]:
        """New photos that are complete, by name; none while one of them is still being written."""
        now = self._sizes()
        still = now == self._seen and all(size for size, _ in now.values())
        self._seen = now
        return [self.folder / name for name in sorted(now)] if still else []

    def take(self, photos: Iterable[Path]) -> None:
        """These are dealt with, whatever comes of them: none is tried twice."""
        self.taken.update(path.name for path in photos)


def twins_photos(out: Path, photos: Path | None) -> set[str]:
    """Names of the photos that the twin in `out` was made from."""
    listed = out / "photos.txt"
    try:
        if listed.is_file():
            return {Path(line).name for line in listed.read_text("utf-8").splitlines() if line.strip()}
        if photos is not None and photos.is_dir():
            return {path.name for path in photos.iterdir()}
    except OSError:
        pass
    return set()
