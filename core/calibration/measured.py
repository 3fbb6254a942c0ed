"""What a calibration photo shows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from .light import Array

Kind = Literal["point", "edge"]
#: Full width at half maximum of a Gaussian over its standard deviation.
FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))


@dataclass(frozen=True)
class MeasuredPsf:
    """A measured point spread; widths are in px of the photo, without the pixel's own footprint.

    Attributes:
        kind: what was photographed.
        space: 'linear' or 'srgb': the values that it was measured on.
        kernel: [K, K] float64, odd, centred, non-negative, sum 1.
        sigma_x, sigma_y, angle: of the Gaussian fitted to it, along its own axes; degrees from x towards y
            (equal widths and 0 from an edge, which shows the blur across itself only).
        sigma, sigma_uncertainty: geometric mean of both widths, and its standard deviation by the fit.
        fwhm: full width at half maximum of the kernel, mean over directions.
        misfit: rms of what the Gaussian leaves over, relative to the peak (point) or the step (edge), noise removed.
        frequencies, mtf: [n] cycles/px up to 0.5 and the contrast that passes there (mean over directions).
        place: (column, row) of the source, or of the edge's middle, px.
        slant: degrees between edge and pixel grid; None for a point.
        notes: what the user should know, one sentence each.
    """

    kind: Kind
    space: str
    kernel: Array = field(repr=False)
    sigma_x: float
    sigma_y: float
    angle: float
    sigma_uncertainty: float
    fwhm: float
    misfit: float
    frequencies: Array = field(repr=False)
    mtf: Array = field(repr=False)
    place: tuple[float, float]
    slant: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def sigma(self) -> float:
        """Geometric mean of the two standard deviations, px."""
        return math.sqrt(self.sigma_x * self.sigma_y)

    @property
    def fwhm_uncertainty(self) -> float:
        """Standard deviation of `fwhm`, as that of a Gaussian of this width, px."""
        return FWHM_PER_SIGMA * self.sigma_uncertainty

    def plain(self) -> dict[str, Any]:
        """For JSON, without the arrays."""
        return {
            "kind": self.kind,
            "space": self.space,
            "kernel_size": list(self.kernel.shape),
            "sigma": self.sigma,
            "sigma_uncertainty": self.sigma_uncertainty,
            "sigma_x": self.sigma_x,
            "sigma_y": self.sigma_y,
            "angle": self.angle,
            "fwhm": self.fwhm,
            "fwhm_uncertainty": self.fwhm_uncertainty,
            "misfit": self.misfit,
            "mtf50": mtf50(self.frequencies, self.mtf),
            "place": list(self.place),
            "slant": self.slant,
            "notes": list(self.notes),
        }


def mtf50(frequencies: Array, mtf: Array) -> float | None:
    """Frequency (cycles/px) where contrast has fallen to one half; None if it does not up to 0.5."""
    below = np.flatnonzero(mtf < 0.5)
    if below.size == 0 or below[0] == 0:
        return None
    i = int(below[0])
    share = (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i])
    return float(frequencies[i - 1] + share * (frequencies[i] - frequencies[i - 1]))
