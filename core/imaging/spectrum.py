"""How much noise there is per signal, at every frequency, read off the blurred photos themselves.

Wiener's inverse wants the ratio n(f) of noise power to the SHARP scene's power. Far beyond what the
medium lets pass, a blurred photo's spectrum is nothing but noise: its floor is measured there. In
the band that passes, spectrum minus floor, divided by |H|^2, is the sharp scene's; natural scenes
fall as a power of frequency (Field 1987), so a line through that band in log-log goes on beyond it.

Brightness and colour are measured apart: colour has far less power at fine scales but the same
noise, and one common ratio would amplify that noise into coloured specks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..numbers import BY_DEFINITION, number
from .contradiction import CONTRADICTION, Observed
from .psf import PointSpread
from .spectral_bins import SpectralBins, frequency_plane

Array = NDArray[np.float64]

#: Orthonormal opponent axes: brightness, red-blue, green-magenta. Rows act on RGB.
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]], np.float64) / np.sqrt([[3.0], [2.0], [6.0]])

#: Rings of equal width in frequency up to `HIGHEST`: the layout of all tables here.
BINS = 96
#: The corner of the frequency plane, cycles/px.
HIGHEST = math.sqrt(0.5)


@dataclass(frozen=True)
class NoiseToSignalSettings:
    """Numbers of the measurement of noise and signal."""

    silent: float = number(1e-8, "share of power", "that a blur passes where a spectrum is taken for nothing but noise")
    faint: float = number(
        1e-3, "share of power", "where the medium silences nothing, the least power below this bounds the noise"
    )
    minimum_bins: int = number(4, "count", "rings that the noise's power is the median of, or a power law is fitted to")
    readable: float = number(
        1e-6, "share of power", "that a blur passes at least where the scene's power is divided out of it"
    )
    flattest: float = number(1.0, "exponent", "of scenes' power over frequency; flatter fits are taken for failures")
    steepest: float = number(4.0, "exponent", "of scenes' power over frequency; steeper fits are taken for failures")
    unseen: float = number(
        2.0, "exponent", "of the scene's power where nothing but noise is seen", "Field 1987, many natural scenes"
    )
    least_ratio: float = number(
        1e-9,
        "power ratio",
        "noise over signal: no less, or the inverse would lose its digits in float32",
        BY_DEFINITION,
    )
    most_ratio: float = number(
        1e3, "power ratio", "noise over signal: beyond, nothing is left of the scene", BY_DEFINITION
    )


NOISE = NoiseToSignalSettings()


@dataclass(frozen=True)
class NoiseToSignal:
    """n(f) at `BINS` equal steps of radial frequency from 0 to sqrt(1/2) cycles/px.

    Attributes:
        brightness, colour: [BINS], noise power over the sharp scene's power, for one photo.
        noise: standard deviation of the photos' noise, in [0, 1] units.
        excess: how many times the power that the blur could have let through the photos hold at fine scales.
        widest: share of the given width at which the photos would no longer contradict the blur; 1 if they do not.
        unexplained: [2, BINS] what contradicts the blur, over the scene's power (brightness, colour); None for none.
    """

    brightness: Array
    colour: Array
    noise: float
    excess: float = 1.0
    widest: float = 1.0
    unexplained: Array | None = None

    @property
    def contradicted(self) -> bool:
        """Whether the photos hold detail that the blur as given cannot have let through."""
        return self.excess > CONTRADICTION.limit

    def trusted(self, gain: float) -> NoiseToSignal:
        """The ratio when the photos are trusted `gain` times as much as their noise alone would allow.

        What contradicts the blur is trusted no more for that: it is in all photos alike.
        """
        brightness, colour = self.brightness / gain, self.colour / gain
        if self.unexplained is not None:
            brightness, colour = brightness + self.unexplained[0], colour + self.unexplained[1]
        return replace(self, brightness=brightness, colour=colour, unexplained=None)


def frequencies() -> Array:
    """[BINS] radial frequencies of the tables, cycles/px."""
    return np.linspace(0.0, HIGHEST, BINS)


def radial_power(planes: NDArray[np.float32]) -> Array:
    """[C, BINS] power spectral density of [C, H, W]; white noise of variance v gives v everywhere."""
    _, h, w = planes.shape
    index = np.minimum(np.rint(np.hypot(*frequency_plane(h, w)) / HIGHEST * (BINS - 1)).astype(int), BINS - 1)
    bins = SpectralBins((h, w), index, BINS)
    out = bins.mean_power(planes - planes.mean(axis=(1, 2), keepdims=True))
    for empty in np.flatnonzero(bins.counts == 0):  # small frames leave gaps
        out[:, empty] = out[:, empty - 1]
    return out


def noise_to_signal(
    photos: Iterable[NDArray[np.float32]], psf: PointSpread | Sequence[PointSpread | None], quantisation: float
) -> NoiseToSignal:
    """Measures n(f) from photos blurred by `psf`.

    Args:
        photos: frames [3, H, W] in the space in which the blur is linear.
        psf: of all photos, or of each: the mean power of photos is the scene's times their mean power transfer.
        quantisation: standard deviation of the rounding alone, the least noise there can be.
    """
    axes = OPPONENT.astype(np.float32)
    power = np.mean([radial_power(np.einsum("ij,jhw->ihw", axes, p)) for p in photos], axis=0)
    spectra = np.stack([power[0], power[1:].mean(axis=0)])
    f = frequencies()
    transfer: Array = np.sqrt(_passed([psf] if isinstance(psf, PointSpread) else psf, f))
    floors = [max(_floor(s, transfer**2, f), quantisation**2) for s in spectra]
    seen = [Observed(s, floor, transfer, f) for s, floor in zip(spectra, floors, strict=True)]
    tables, noise, excess = [_ratio(one) for one in seen], math.sqrt(floors[0]), seen[0].excess()
    if excess <= CONTRADICTION.limit:
        return NoiseToSignal(tables[0], tables[1], noise, excess)
    unexplained = np.stack([one.unexplained() for one in seen])
    return NoiseToSignal(tables[0], tables[1], noise, excess, seen[0].widest(), unexplained)


def _passed(spreads: Sequence[PointSpread | None], f: Array) -> Array:
    """[BINS] mean share of power that passes, over point spreads and directions."""
    known = {
        psf: np.ones_like(f) if psf is None else np.mean([psf.mtf(f, a) ** 2 for a in np.arange(0, 180, 22.5)], axis=0)
        for psf in dict.fromkeys(spreads)
    }
    if len(known) == 1:
        return np.asarray(next(iter(known.values())))
    return np.asarray(np.mean([known[psf] for psf in spreads], axis=0))


def _floor(spectrum: Array, passed: Array, f: Array) -> float:
    """Power of the noise: of what is left where the blur lets nothing pass, or at least hardly anything."""
    silent = (passed < NOISE.silent) & (f <= 0.5)
    if silent.sum() >= NOISE.minimum_bins:
        return float(np.median(spectrum[silent]))
    faint = (passed < NOISE.faint) & (f <= 0.5)
    return float(spectrum[faint].min()) if faint.any() else 0.0


def _ratio(seen: Observed) -> Array:
    """floor / S(f), with S a power law through the band where the photo stands clear of the floor."""
    spectrum, floor, f = seen.power, seen.floor, seen.f
    passed = seen.transfer**2
    clear = seen.clear & (passed > NOISE.readable)
    signal = (spectrum - floor) / np.maximum(passed, 1e-12)
    if clear.sum() < NOISE.minimum_bins:  # nothing but noise: believe nothing beyond the lowest frequencies
        exponent = NOISE.unseen
        level = math.log(max(float(spectrum[1] - floor), 1e-12)) + exponent * math.log(f[1])
    else:
        x, y = np.log(f[clear]), np.log(signal[clear])
        exponent = float(-np.polyfit(x, y, 1)[0])
        exponent = min(max(exponent, NOISE.flattest), NOISE.steepest)
        level = float(np.mean(y + exponent * x))
    fitted = np.exp(level - exponent * np.log(np.maximum(f, f[1])))
    return np.asarray(np.clip(floor / fitted, NOISE.least_ratio, NOISE.most_ratio))
