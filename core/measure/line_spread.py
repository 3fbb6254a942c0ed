"""What a blur makes of a thin straight line: its line spread function, the point spread projected across it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ..imaging.psf import PointSpread
from ..numbers import BY_DEFINITION, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineSpreadSettings:
    """How a line spread is kept."""

    step: float = number(0.1, "px", "between the samples of a line spread, linear between them")
    reach: float = number(5.0, "standard deviations", "to either side: what lies farther out is 1e-6 of a Gaussian")
    pixel: float = number(
        12**-0.5, "px", "standard deviation of a square px, which adds up light before the blur is seen", BY_DEFINITION
    )


SETTINGS = LineSpreadSettings()


@dataclass(frozen=True)
class LineSpread:
    """Light of a thin line, across it.

    Attributes:
        places: [n] px from the line, evenly, increasing.
        density: [n] per px; its integral is 1.
        passed: [n] integral up to each place: the edge spread.
        across, along: standard deviation (px) of the blur across the line and along it.
    """

    places: Array = field(repr=False)
    density: Array = field(repr=False)
    passed: Array = field(repr=False)
    across: float
    along: float

    def line(self, x: Array) -> Array:
        """The density at distances from the line."""
        return np.asarray(np.interp(x, self.places, self.density, left=0.0, right=0.0))

    def edge(self, x: Array) -> Array:
        """The light of a half plane that begins at 0, at distances inwards from its edge."""
        return np.asarray(np.interp(x, self.places, self.passed, left=0.0, right=1.0))


def line_spread(psf: PointSpread, axes: Array) -> LineSpread:
    """That of a point spread.

    Args:
        axes: [2, 2] unit directions across the line and along it, in the photo.
    """
    covariance = axes @ psf.covariance @ axes.T + SETTINGS.pixel**2 * np.eye(2)
    across, along = (float(np.sqrt(covariance[k, k])) for k in (0, 1))
    count = int(np.ceil(SETTINGS.reach * across / SETTINGS.step))
    places = np.arange(-count, count + 1) * SETTINGS.step
    if psf.samples is None:
        passed = ndtr(places / across)
    else:
        kernel = psf.kernel()
        rows, columns = (np.arange(n) - n // 2 for n in kernel.shape)
        offsets = axes[0, 0] * columns[None, :] + axes[0, 1] * rows[:, None]
        passed = ndtr((places[:, None] - offsets[kernel > 0]) / SETTINGS.pixel) @ kernel[kernel > 0]
    return LineSpread(places, np.gradient(passed, places), passed, across, along)


def widened(spread: LineSpread, factor: float) -> LineSpread:
    """The same, `factor` times as wide."""
    return LineSpread(
        spread.places * factor, spread.density / factor, spread.passed, spread.across * factor, spread.along * factor
    )
