"""Photos from a movie: the sharpest frame of each of many equal stretches of time.

The camera of a movie moves while it exposes, and shakes: neighbouring frames differ in sharpness, and
hardly in viewpoint. So the movie is cut into stretches, and each gives its sharpest frame. A stretch
that shows what the one before showed, because the camera stood still, gives none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import Cancelled, DeviceError, PhotoError
from ..files import make_folder, read_json, replacing, write_json
from ..numbers import number
from ..progress import Progress
from .kinds import MOVIES
from .movie_tables import BOXED, check_tables
from .scale import size_within

#: From this height on, movies that do not say how their colours are coded use BT.709, else BT.601.
_HIGH_DEFINITION = 720
_LIST = "frames.json"
#: Of a frame, at most: as many as the largest format that movies have (16K, 15360 x 8640). A decoder keeps several.
_MOST_PIXELS = 2**27


@dataclass(frozen=True)
class MovieSettings:
    """Of the choice of frames."""

    middle: float = number(
        0.7, "share", "of each stretch, around its middle, that frames are taken from: two never lie side by side"
    )
    measured_size: int = number(
        480, "px", "longest side on which sharpness is measured: the finest detail of a movie is the compression's"
    )
    compared_size: int = number(96, "px", "longest side on which two frames are compared")
    same: float = number(1.0, "8-bit steps", "mean difference below which two frames show the same")


SETTINGS = MovieSettings()


@dataclass(frozen=True)
class _Best:
    """The sharpest frame of a stretch so far."""

    index: int
    sharpness: float
    frame: Any
    small: NDArray[np.float32]


def is_movie(path: Path) -> bool:
    """Whether a path names a movie, by its ending."""
    return path.suffix.lower() in MOVIES


def extract_frames(movie: Path, folder: Path, count: int, progress: Progress) -> Path:
    """Writes at most `count` frames of a movie as PNG.

    Args:
        movie: any file that FFmpeg decodes.
        folder: gets frame_000123.png (numbered as in the movie, upright, 8-bit sRGB values as the movie
            encodes them) and frames.json. What was extracted from the same movie before is used again.
        count: stretches the movie is cut into, at least 2.
        progress: hears of each stretch (stage 'movie'); may cancel.

    Returns:
        `folder`.

    Raises:
        PhotoError: no movie, a damaged one, or one in which the camera stands still.
        DeviceError: PyAV is not installed.
        OutputError: the frames cannot be written.
        Cancelled: the user asked to stop.
    """
    if not movie.is_file():
        raise PhotoError(f"There is no movie '{movie}'", "Check its path")
    asked = {
        "movie": str(movie.resolve()),
        "bytes": movie.stat().st_size,
        "changed": movie.stat().st_mtime_ns,
        "count": count,
    }
    if _done(folder, asked):
        return folder
    make_folder(folder)
    (folder / _LIST).unlink(missing_ok=True)
    for old in folder.glob("frame_*.png"):
        old.unlink()
    names: list[str] = []
    before: _Best | None = None
    for best in _best_frames(movie, count, progress):
        if before is not None and float(np.abs(best.small - before.small).mean()) < SETTINGS.same:
            continue
        before = best
        names.append(f"frame_{best.index:06}.png")
        with replacing(folder / names[-1]) as temporary:
            Image.fromarray(_pixels(best.frame)).save(temporary, compress_level=1)
    if len(names) < 2:
        raise PhotoError(
            f"'{movie.name}' shows {len(names) or 'no'} view{'' if len(names) == 1 else 's'} only",
            "Move the camera around the object while it films",
        )
    progress.note(f"{len(names)} frames of '{movie.name}' are used")
    write_json(folder / _LIST, {**asked, "frames": names})
    return folder


def sharpness(grey: NDArray[np.float32]) -> float:
    """How much fine detail [H, W] holds: energy of its differences over its variance, so that neither
    exposure nor contrast counts. 0 for a flat picture.
    """
    variance = float(grey.var())
    if variance < 1e-6 or min(grey.shape) < 2:
        return 0.0
    energy = float(np.square(np.diff(grey, axis=0)).mean() + np.square(np.diff(grey, axis=1)).mean())
    return energy / variance


def _best_frames(movie: Path, count: int, progress: Progress) -> Iterator[_Best]:
    """The sharpest frame of each stretch, in order."""
    progress.stage("movie", count)
    current, best = 0, None
    with _opened(movie) as container:
        length = _seconds(container)
        for index, frame in enumerate(container.decode(video=0)):
            if progress.cancelled():
                raise Cancelled("Stopped while reading the movie")
            place = (frame.time if frame.time is not None else index / 25.0) / length * count
            stretch = min(max(int(place), 0), count - 1)
            if stretch != current:
                if best is not None:
                    yield best
                current, best = stretch, None
                progress.advance(stretch)
            if best is None or abs(place - stretch - 0.5) <= 0.5 * SETTINGS.middle:
                candidate = _measured(index, frame)
                if best is None or candidate.sharpness > best.sharpness:
                    best = candidate
    if best is not None:
        yield best
    progress.advance(count)


def _measured(index: int, frame: Any) -> _Best:
    grey = [
        frame.reformat(*size_within(frame.width, frame.height, longest), format="gray", interpolation="AREA")
        .to_ndarray()
        .astype(np.float32)
        for longest in (SETTINGS.measured_size, SETTINGS.compared_size)
    ]
    return _Best(index, sharpness(grey[0]), frame, grey[1])


def _pixels(frame: Any) -> NDArray[np.uint8]:
    """[H, W, 3] uint8, upright."""
    from av.video.reformatter import Colorspace  # late: as av

    given = int(frame.colorspace)
    unspecified = given == 2  # AVCOL_SPC_UNSPECIFIED
    usual = Colorspace.ITU709 if frame.height >= _HIGH_DEFINITION else Colorspace.ITU601
    array = frame.to_ndarray(format="rgb24", src_colorspace=usual if unspecified else None)
    # Phones film portrait as turned landscape; the frame's angle says how it is to be shown.
    turned = np.rot90(array, round(frame.rotation / 90.0) % 4)
    return np.ascontiguousarray(turned)


def _opened(movie: Path) -> Any:
    try:
        import av  # late: not everywhere
    except ImportError as error:
        raise DeviceError(
            "Movies need the package 'av', which the engine's Python does not have",
            "Install the engine again, or give the movie's frames as photos",
        ) from error
    return _Reading(av, movie)


class _Reading:
    """A movie that is open; whatever its decoder raises comes as a PhotoError."""

    def __init__(self, av: Any, movie: Path) -> None:
        self._av, self._movie = av, movie

    def __enter__(self) -> Any:
        try:
            if self._movie.suffix.lower() in BOXED:
                check_tables(self._movie)
            self._container = self._av.open(str(self._movie))
            if not self._container.streams.video:
                raise PhotoError(f"'{self._movie.name}' has no pictures, only sound", "Choose a movie")
            stream = self._container.streams.video[0]
            if stream.codec_context is None:
                raise PhotoError(f"'{self._movie.name}' is coded in a way that is not known here", "Export it again")
            stream.thread_type = "AUTO"
            stream.codec_context.options = {
                "max_pixels": str(_MOST_PIXELS)
            }  # (of a frame inside, whatever is declared)
            if stream.codec_context.width * stream.codec_context.height > _MOST_PIXELS:
                size = f"{stream.codec_context.width} x {stream.codec_context.height} px"
                raise PhotoError(f"'{self._movie.name}' declares frames of {size}", "Export it smaller")
        except (self._av.FFmpegError, OSError, ValueError, MemoryError) as error:
            raise self._explained(error) from error
        return self._container

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._container.close()
        if isinstance(error, (self._av.FFmpegError, OSError, ValueError, MemoryError)):
            raise self._explained(error) from error

    def _explained(self, error: BaseException) -> PhotoError:
        if isinstance(error, MemoryError):
            return PhotoError(
                f"'{self._movie.name}' needs more memory than there is, or declares what no memory holds",
                "Export it smaller, or copy it again",
            )
        reason = str(error).strip().splitlines()[0][:120] if str(error).strip() else type(error).__name__
        return PhotoError(f"'{self._movie.name}' cannot be read as a movie ({reason})", "Export or copy it again")


def _seconds(container: Any) -> float:
    """Length of the movie, roughly where the file does not tell."""
    stream = container.streams.video[0]
    if stream.duration is not None and stream.time_base is not None:
        return max(float(stream.duration * stream.time_base), 1e-3)
    if container.duration is not None:
        return max(container.duration / 1e6, 1e-3)
    return max((stream.frames or 1500) / float(stream.average_rate or 25), 1e-3)


def _done(folder: Path, asked: dict[str, Any]) -> bool:
    try:
        held = read_json(folder / _LIST)
        return {key: held[key] for key in asked} == asked and all((folder / name).is_file() for name in held["frames"])
    except (OSError, ValueError, KeyError, TypeError):
        return False
