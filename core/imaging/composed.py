"""The blur that a camera sees which moved while the shutter was open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PsfError
from ..numbers import BY_DEFINITION, number
from .kernel_samples import convolved_samples, spreading, trimmed
from .psf import PointSpread

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PathSettings:
    """Numbers of the kernel of a straight path."""

    density: int = number(8, "points per px", "of a path: the grid sees no difference to a line")
    undershoot: float = number(
        1e-2,
        "share of the peak",
        "below which a cubic's undershoot is cut; a path that has more is antialiased by the hat instead",
    )
    widest: float = number(
        300.0,
        "px",
        "standard deviation of a Gaussian that takes a path: the samples of both fill 60 MB; those of 1000 px took 18 s"
        " and 0.9 GB",
        BY_DEFINITION,
    )
    longest: float = number(512.0, "px", "longest path: a kernel must hold it", BY_DEFINITION)


PATH = PathSettings()


def moved(psf: PointSpread | None, length: float, angle: float) -> PointSpread | None:
    """The blur of a camera that moved straight and evenly while the shutter was open.

    Args:
        psf: the blur without motion, None for none; the very same object comes back for a length of 0.
        length: of the path on the photo, px; its variance along itself is length^2 / 12. Without any other blur the
            antialiasing adds up to 1/4 px^2.
        angle: degrees from x towards y.

    Raises:
        PsfError: a length that makes no sense.
    """
    path = f"path:{length:.6g},{angle:.6g}"
    if not (math.isfinite(length) and math.isfinite(angle) and 0.0 <= length <= PATH.longest):
        raise PsfError(f"The path '{path}' makes no sense", f"Give 0 to {PATH.longest:g} px and an angle in degrees")
    if length == 0.0:
        return psf
    if psf is not None and psf.samples is None and max(psf.sigma_x, psf.sigma_y) > PATH.widest:
        raise PsfError(f"Beside a blur as wide as '{psf.source}' the path '{path}' is nothing", "Leave the path out")
    # Spread by a cubic a path keeps its variance to the last digit; the other blur smooths what undershoots.
    samples = _path(length, angle, linear=psf is None or psf.is_identity)
    source = path
    if psf is not None and not psf.is_identity:
        cubic = convolved_samples(psf.kernel(), samples)
        crude = cubic.min() < -PATH.undershoot * cubic.max()
        samples = convolved_samples(psf.kernel(), _path(length, angle, linear=True)) if crude else cubic
        source = f"{psf.source}+{path}"
    notes = () if psf is None else psf.notes
    samples = samples.clip(min=0.0)
    return PointSpread("file", samples=trimmed(samples / samples.sum()), source=source, notes=notes)


def _path(length: float, angle: float, linear: bool) -> Array:
    """[K, L], odd, of sum 1, centred; `linear` never undershoots, the cubic keeps the variance."""
    count = max(2, math.ceil(PATH.density * length))
    # Middles of equal pieces have 1 - 1 / n^2 of the line's variance: they are moved outwards.
    along = ((np.arange(count) + 0.5) / count - 0.5) * length / math.sqrt(1.0 - 1.0 / count**2)
    rows, columns = (along * turn for turn in (math.sin(math.radians(angle)), math.cos(math.radians(angle))))
    return np.asarray(_placed(rows, linear) @ _placed(columns, linear).T / count)


def _placed(position: Array, linear: bool) -> Array:
    """[2 r + 1, N]: how points at `position` (px from the middle) light a row of px."""
    radius = math.ceil(float(np.abs(position).max())) + 2
    return spreading(np.abs(np.arange(-radius, radius + 1)[:, None] - position[None, :]), linear)
