"""Point spreads as text: what `--psf` and reports hold."""

from __future__ import annotations

import math
from pathlib import Path

from ..errors import PsfError
from .composed import moved
from .kernel_files import read_kernel
from .psf import PointSpread, point_spread_from_samples

#: Kinds of file that `kernel_files` reads; such a path is a PSF without `file:` before it.
KERNEL_SUFFIXES = frozenset({".npy", ".tif", ".tiff", ".png", ".fits", ".fit", ".fts"})
#: Standard deviation in px; the samples of a wider Gaussian would fill the memory, and leave nothing of a photo.
_WIDEST = 1000.0
#: Of a text: no shake of a hand needs more paths, and no file's path has more characters.
_MOST_PATHS, _LONGEST = 8, 5000


def parse_psf(text: str) -> PointSpread | None:
    """Reads `none`, `gaussian:SIGMA`, `gaussian:SX,SY,ANGLE` (px, px, degrees), `file:PATH` or a kernel file's path.

    `path:LENGTH,ANGLE` is a straight path of motion (px, degrees), alone or behind one of these: `gaussian:3+path:8,3`.

    Returns:
        None for `none`.

    Raises:
        PsfError: the text or the file makes no sense; it says why.
    """
    if text.count("path:") > _MOST_PATHS or len(text) > _LONGEST:
        raise PsfError(f"The PSF '{text[:60]}...' is too long", f"Give at most {_MOST_PATHS} paths")
    blur, mark, path_text = text.strip().rpartition("path:")
    if mark and (not blur or blur.endswith("+")):
        return moved(parse_psf(blur[:-1]) if blur else None, *parse_path(path_text))
    kind, _, rest = text.strip().partition(":")
    if kind == "none" and not rest:
        return None
    if kind == "gaussian":
        try:
            values = [float(v) for v in rest.split(",")]
        except ValueError:
            values = []
        if len(values) not in (1, 2, 3) or not all(map(math.isfinite, values)):
            raise PsfError(f"The PSF '{text}' is not a Gaussian", "Write gaussian:5 or gaussian:SX,SY,ANGLE")
        sx, sy, angle = (values + [values[0], 0.0][len(values) - 1 :])[:3]
        if sx < 0 or sy < 0:
            raise PsfError(f"The PSF '{text}' has a negative width", "Give standard deviations in pixels")
        if max(sx, sy) > _WIDEST:
            raise PsfError(f"The PSF '{text}' is wider than any photo", f"Give at most {_WIDEST:g} px")
        return PointSpread(sigma_x=sx, sigma_y=sy, angle=angle, source=text.strip())
    path = rest if kind == "file" else text.strip()
    if path and (kind == "file" or Path(path).suffix.lower() in KERNEL_SUFFIXES):
        return point_spread_from_samples(read_kernel(Path(path)), text.strip())
    raise PsfError(
        f"There is no PSF '{text}'",
        "Write none, gaussian:5, gaussian:SX,SY,ANGLE, file:PATH (NPY, TIFF, PNG, FITS) or path:LENGTH,ANGLE",
    )


def parse_path(text: str) -> tuple[float, float]:
    """Reads `LENGTH,ANGLE` (px, degrees); raises PsfError."""
    try:
        length, angle = (float(value) for value in text.split(","))
    except ValueError:
        raise PsfError(f"The path 'path:{text}' is no path", "Write path:LENGTH,ANGLE (px, degrees)") from None
    return length, angle
