"""What a reconstruction's photos are read from."""

from __future__ import annotations

from pathlib import Path

from ..progress import Progress
from .movie import extract_frames, is_movie


def photo_source(given: Path, out: Path, frames: int, progress: Progress) -> Path:
    """What photos are read from: a movie becomes the folder of its frames, OUT/frames; all else stays.

    Raises:
        DgsError: the movie cannot be used (see `extract_frames`).
    """
    if is_movie(given) and not given.is_dir():
        return extract_frames(given, out / "frames", frames, progress)
    return given
