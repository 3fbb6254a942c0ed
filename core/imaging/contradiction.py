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

from ..numbers import BY_DEFINITION, number

Array = NDArray[np.float64]

#: What several of these numbers were chosen on.
_FOUR_SETS = "four sets of photos, blurs given rightly and wrongly (benchmarks/wrong_blur.py)"


@dataclass(frozen=True)
class ContradictionSettings:
    """Numbers of the test whether photos contradict a blur."""

    limit: float = number(
        4.0,
        "ratio of powers",
        "from which photos contradict a blur, in brightness (JPEG distorts colours more): given rightly, the sets reach"
        " 3.1, as JPEG 3.5; given 20 % too wide, at least 4.6; a disc given as a Gaussian, 15 and more",
        _FOUR_SETS,
    )
    explained: float = number(
        1.3, "ratio of powers", "once contradicted, what exceeds the expected power by this factor is distrusted"
    )
    distrust: float = number(
        20.0,
        "noise power per excess power",
        "Noise calls for one careful inversion; here iterating would amplify the excess step by step as far as it"
        " agrees between photos. With 1 a ball's blur given 20 % too wide ends 0.3 dB below plain splatting, with 5"
        " 0.1 above, with 20 0.5 above.",
        "one set, a ball, its blur given 20 % too wide",
    )
    passing: float = number(
        0.05, "share of power", "that a blur leaves where the scene's power law is read; less is read as fine detail"
    )
    flattest: float = number(0.0, "exponent", "of scenes' power over frequency: white texture", BY_DEFINITION)
    steepest: float = number(4.0, "exponent", "of scenes' power over frequency; steeper fits are taken for failures")
    minimum_bins: int = number(4, "count", "rings that the power law is fitted to")
    lowest: float = number(0.01, "cycles/px", "lowest frequency, below which the window smears the spectrum")
    clear_power: float = number(4.0, "noise power", "from which photos show something")
    narrowest: float = number(
        0.2, "share of the given width", "narrowest blur that a contradicted one is compared with"
    )
    widths: int = number(81, "count", "of widths tried between that and the given one, widest first: steps of 1 %")


CONTRADICTION = ContradictionSettings()
#: Shares of the width at which a contradicted blur is tried, widest first.
_WIDTHS = np.linspace(1.0, CONTRADICTION.narrowest, CONTRADICTION.widths)


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
        return np.asarray((self.power > CONTRADICTION.clear_power * self.floor) & (self.f > CONTRADICTION.lowest))

    @property
    def fine(self) -> NDArray[np.bool_]:
        """[BINS] where they do although the blur should leave little."""
        return np.asarray(self.clear & (self.transfer**2 < CONTRADICTION.passing))

    def scene(self) -> Array | None:
        """[BINS] the sharp scene's power, continued from where the blur lets most pass; None where too little does."""
        low = self.clear & (self.transfer**2 > CONTRADICTION.passing)
        if low.sum() < CONTRADICTION.minimum_bins:
            return None
        x, y = np.log(self.f[low]), np.log((self.power - self.floor)[low] / self.transfer[low] ** 2)
        exponent = float(np.clip(-np.polyfit(x, y, 1)[0], CONTRADICTION.flattest, CONTRADICTION.steepest))
        level = float(np.mean(y + exponent * x))
        return np.asarray(np.exp(level - exponent * np.log(np.maximum(self.f, self.f[1]))))

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
        over = np.maximum(self.power - CONTRADICTION.explained * (self.transfer**2 * scene + self.floor), 0.0)
        return np.asarray(np.maximum.accumulate(np.where(self.fine, CONTRADICTION.distrust * over / scene, 0.0)))

    def widest(self) -> float:
        """The largest share of the given width at which the photos hold what that blur may have let through."""
        for share in _WIDTHS:
            narrower = replace(self, transfer=np.interp(share * self.f, self.f, self.transfer))
            if narrower.excess() < math.sqrt(CONTRADICTION.limit):
                return float(share)
        return float(_WIDTHS[-1])
