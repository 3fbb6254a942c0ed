"""Do the photos hold more fine detail than the blur that was given could have let through?

A blur given too wide is worse than one given too narrow: its inverse lifts what the true medium left far
above what stood there, and nothing in the photos holds against it. But it shows in the spectrum. Where the
given blur lets most pass, spectrum over |H|^2 is the sharp scene's, a power of frequency (Field 1987); towards finer
scales |H|^2 times that power is the most that the photos can hold besides noise. A true blur that is narrower, or of
another family with a long spectrum (a disc's side lobes), exceeds it by orders of magnitude.

Such an excess cannot be inverted by the given blur: it is counted as noise that many photos have in common, so that
their number does not average it away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Photos contradict a blur from this ratio of powers on, in brightness (JPEG distorts colours more). Told rightly,
#: four test sets reach 3.1, as JPEG 3.5; given 20 % too wide, at least 4.6; a disc given as a Gaussian, 15 and more
#: (benchmarks/wrong_blur.py; the limit was set on these sets).
CONTRADICTED = 4.0
#: Power that is explained: once contradicted, what exceeds the expected by this factor is distrusted.
_EXPLAINED = 1.3
#: The excess weighs so many times as noise of the same power. Noise calls for one careful inversion; here iterating
#: would amplify the excess step by step as far as it agrees between photos. Measured: 1 leaves a ball given 20 % too
#: wide 0.3 dB below plain splatting, 5 is 0.1 above, 20 0.5.
_DISTRUST = 20.0
#: The scene's power law is read where the blur leaves at least this share of the power.
_PASSING = 0.05
#: Slopes that scenes' power spectra may have; 0 is white texture.
_SLOPES = (0.0, 4.0)
#: Bins that a line is fitted to, at least; the lowest frequency (cycles/px) that the window does not smear.
_ENOUGH, _LOWEST = 4, 0.01
#: Photos show something where their power is this many times the noise's.
_CLEAR = 4.0
#: A blur contradicted is tried at these shares of its width, widest first.
_WIDTHS = np.linspace(1.0, 0.2, 81)


@dataclass(frozen=True)
class Observed:
    """What photos show of a scene through a blur, over radial frequency.

    Attributes:
        power: [BINS] power spectral density of the photos.
        floor: that of their noise.
        transfer: [BINS] |H| of the blur that was given, root mean square over directions.
        f: [BINS] cycles/px.
    """

    power: Array
    floor: float
    transfer: Array
    f: Array

    @property
    def clear(self) -> NDArray[np.bool_]:
        """[BINS] where the photos stand clear of the noise."""
        return np.asarray((self.power > _CLEAR * self.floor) & (self.f > _LOWEST))

    @property
    def fine(self) -> NDArray[np.bool_]:
        """[BINS] where they do although the blur should leave little."""
        return np.asarray(self.clear & (self.transfer**2 < _PASSING))

    def scene(self) -> Array | None:
        """[BINS] the sharp scene's power, continued from where the blur lets most pass; None where too little does."""
        low = self.clear & (self.transfer**2 > _PASSING)
        if low.sum() < _ENOUGH:
            return None
        x, y = np.log(self.f[low]), np.log((self.power - self.floor)[low] / self.transfer[low] ** 2)
        slope = float(np.clip(-np.polyfit(x, y, 1)[0], *_SLOPES))
        level = float(np.mean(y + slope * x))
        return np.asarray(np.exp(level - slope * np.log(np.maximum(self.f, self.f[1]))))

    def excess(self) -> float:
        """How many times the expected power the photos hold at fine scales; 1 where it cannot be estimated."""
        scene, fine = self.scene(), self.fine
        if scene is None or not fine.any():
            return 1.0
        return float((self.power / (self.transfer**2 * scene + self.floor))[fine].max())

    def unexplained(self) -> Array:
        """[BINS] weighted power over the scene's that the blur does not explain; having begun, it stays."""
        scene = self.scene()
        if scene is None:
            return np.zeros_like(self.f)
        over = np.maximum(self.power - _EXPLAINED * (self.transfer**2 * scene + self.floor), 0.0)
        return np.asarray(np.maximum.accumulate(np.where(self.fine, _DISTRUST * over / scene, 0.0)))

    def widest(self) -> float:
        """The largest share of the given width at which the photos hold what that blur may have let through."""
        for share in _WIDTHS:
            narrower = replace(self, transfer=np.interp(share * self.f, self.f, self.transfer))
            if narrower.excess() < math.sqrt(CONTRADICTED):
                return float(share)
        return float(_WIDTHS[-1])
