"""Curved ways of a camera that explain a shaken photo, found from many starts.

A photo is nearly the picture without motion, convolved with what the camera's way leaves of a point of light. At the
frequency f a way x(t) has the transfer k(f) = mean over t of exp(-2 pi i f . x(t)), and leaves of the photo

    |photo - k picture|^2 = |photo|^2 - 2 Re(k* picture* photo) + |k|^2 |picture|^2.

No more than two correlations of the whole photo enter, at lags as short as ways are: once they are known, a way is
asked in a millisecond. So ways of all directions are followed downhill, first on what is coarse, where they have few
hollows to end in. The picture's contrast is left free: else ways throw a part of the light far away only to pale it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from ...colour import srgb_to_linear
from ...numbers import BY_DEFINITION, number

Array = NDArray[np.float64]

#: What the numbers below were chosen on.
_ALONG_COPR = "photos shaken along a twin of copr by 4 to 20 px, true cameras, one run"


@dataclass(frozen=True)
class CurvedWaySettings:
    """Numbers of the search for curved ways."""

    directions: int = number(4, "count", "of the straight ways that are bent either way to start with", _ALONG_COPR)
    begin: float = number(
        0.5,
        "of the likely way",
        "that starts are long: what is too long at first holds itself in another hollow",
        _ALONG_COPR,
    )
    bent: float = number(0.35, "of half of a start", "by which it is bent at first, either way", _ALONG_COPR)
    coarse: float = number(
        0.33, "of the likely way", "standard deviation (px) of the blur that photos are asked through at first"
    )
    fine: float = number(0.25, "px of the grid", "the same at the end")
    places: int = number(33, "count", "of a way that make its transfer: those of the longest lie 1.3 px apart")
    steps: int = number(25, "count", "of the descent on each scale at most")
    least_reach: int = number(32, "px", "of the lags, either way, at least", BY_DEFINITION)
    faint: float = number(1e-3, "of the largest weight", "frequencies are left out whose weight is less", BY_DEFINITION)
    nearer: float = number(
        1e-4, "of the picture's power", "that another way has to leave less of the photo than the own one", _ALONG_COPR
    )
    apart: float = number(0.7, "px of the grid", "rms that it has to lie beside it: nearer ones find it by themselves")
    kept: int = number(4, "count", "of the different ways that are followed from one scale to the next one")
    same: float = number(0.1, "px", "rms that two ways lie beside each other where they are the same")
    reach: float = number(1.5, "of the likely way", "that lags reach at least", BY_DEFINITION)
    longest: float = number(42.0, "px", "of a likely way; longer ones are sought in photos that are averaged first")
    least_left: float = number(1e-3, "of the picture's power", "that counts as left of a photo at least: rounding")


SETTINGS = CurvedWaySettings()


@dataclass(frozen=True)
class Alike:
    """How a photo and the picture without motion are alike, px by px, of windowed light and summed over channels.

    Attributes:
        of_picture: [2R, 2R] the picture's correlation with itself at lags of -R to R - 1 px, lag 0 first; 1 there.
        of_both: [2R, 2R] that of the picture with the photo, in the same unit.
        power: of the photo, in the same unit.
    """

    of_picture: Array
    of_both: Array
    power: float

    @staticmethod
    def of(still: Tensor, photo: Tensor, counts: Tensor | None, reach: int) -> Alike:
        """Of the picture without motion and the photo, [3, H, W] sRGB, at lags of at most `reach` px.

        Args:
            counts: [H, W] px of the photo that count, 0 to 1; None for all.
        """
        height, width = photo.shape[1:]
        size = height + reach, width + reach
        lights = [_windowed(planes, counts) for planes in (still, photo)]
        picture, seen = (np.fft.rfft2(light, s=size) for light in lights)
        own = np.fft.irfft2((picture.real**2 + picture.imag**2).sum(axis=0), s=size)
        both = np.fft.irfft2((picture.conj() * seen).sum(axis=0), s=size)
        power, unit = float(np.square(lights[1]).sum()), max(float(own[0, 0]), 1e-12)
        return Alike(_near(own, reach) / unit, _near(both, reach) / unit, power / unit)


def _windowed(planes: Tensor, counts: Tensor | None) -> Array:
    """[3, H, W] light, less its mean, that fades towards the border; nothing where it does not count."""
    light = srgb_to_linear(planes.cpu()).double().numpy()
    height, width = light.shape[1:]
    window = np.hanning(height)[:, None] * np.hanning(width)[None, :]
    if counts is not None:
        window = window * counts.cpu().double().numpy()
    return np.asarray((light - light.mean(axis=(1, 2), keepdims=True)) * window)


def _near(correlation: Array, reach: int) -> Array:
    """[2R, 2R] of the lags of -R to R - 1."""
    lags = np.r_[0:reach, -reach:0]
    return np.ascontiguousarray(correlation[np.ix_(lags, lags)])


@dataclass(frozen=True)
class Scale:
    """Frequencies that are asked on one scale: down [F], right [G], and the weighted spectra [F, G] there."""

    down: Array
    right: Array
    of_picture: Array
    of_both: NDArray[np.complex128]


class ExplainedPhoto:
    """How well ways explain a photo, as the picture without motion is.

    Args:
        likely: [M + 1] standard deviations of a way's coefficients, px; infinite where nothing is known.
        independent: px that the photo counts as.
    """

    def __init__(self, alike: Alike, likely: Array, independent: float) -> None:
        self._size = len(alike.of_picture)
        self._own = np.fft.rfft2(alike.of_picture).real
        self._both = np.fft.rfft2(alike.of_both)
        self._power, self._independent, self._order = alike.power, independent, len(likely) - 1
        middles = (2.0 * np.arange(SETTINGS.places) + 1.0) / SETTINGS.places - 1.0
        self._basis = np.polynomial.legendre.legvander(middles, self._order)
        self._unlikely = np.tile(1.0 / np.square(likely), 2)
        self._price = 0.0

    def scale(self, sigma: float) -> Scale:
        """What is left of all frequencies once photo and picture are blurred by `sigma` px."""
        down, right = np.fft.fftfreq(self._size), np.fft.rfftfreq(self._size)
        pass_down, pass_right = (np.exp(-2.0 * np.square(np.pi * sigma * along)) for along in (down, right))
        rows, columns = pass_down > SETTINGS.faint, pass_right > SETTINGS.faint
        twice = np.where((right == 0.0) | (right == 0.5), 1.0, 2.0)  # (those of negative frequencies are the same)
        weight = (pass_down[:, None] * (pass_right * twice)[None, :])[np.ix_(rows, columns)] / self._size**2
        at = np.ix_(rows, columns)
        return Scale(down[rows], right[columns], weight * self._own[at], weight * self._both[at])

    def apart(self, first: Array, second: Array) -> float:
        """px rms between two ways, run in the direction that suits."""
        ways = [self._basis @ way.reshape(2, -1).T for way in (first, second)]
        both = (np.square(ways[0] - other).sum(axis=1).mean() for other in (ways[1], ways[1][::-1]))
        return math.sqrt(min(both))

    def cost(self, way: Array, scale: Scale) -> tuple[float, Array]:
        """What a way's coefficients [2 (M + 1)], those along x first, leave of the photo, less all of it, and the
        derivative by them; the picture is as bright as suits best."""
        along_x, along_y = (self._basis @ way.reshape(2, -1).T).T
        right = np.exp(-2j * np.pi * along_x[:, None] * scale.right)
        down = np.exp(-2j * np.pi * along_y[:, None] * scale.down)
        count = len(along_x)
        transfer = down.T @ right / count
        both = float((transfer * scale.of_both.conj()).real.sum())
        own = max(float((scale.of_picture * np.square(np.abs(transfer))).sum()), 1e-12)
        pale = both / own
        back = (pale * pale * scale.of_picture * transfer - pale * scale.of_both).conj()
        by_x = ((down @ back) * right * (-2j * np.pi * scale.right)).real.sum(axis=1)
        by_y = (((down * (-2j * np.pi * scale.down)) @ back) * right).real.sum(axis=1)
        slope = np.concatenate([self._basis.T @ by_x, self._basis.T @ by_y]) * (2.0 / count)
        price = self._price * self._unlikely * way
        return -both * pale + float(price @ way), slope + 2.0 * price

    def followed(self, way: Array, scales: Sequence[Scale]) -> Array:
        """The coefficients [2 (M + 1)] where a way comes to rest on one scale after the other."""
        for scale in scales:
            way = minimize(self.cost, way, (scale,), "L-BFGS-B", jac=True, options={"maxiter": SETTINGS.steps}).x
        return way

    def different(self, ways: Sequence[Array], scale: Scale) -> list[Array]:
        """Those of some ways that leave least of the photo, each once."""
        costs = [self.cost(way, scale)[0] for way in ways]
        kept: list[Array] = []
        for index in np.argsort(costs, kind="stable"):
            if len(kept) < SETTINGS.kept and all(self.apart(ways[index], way) > SETTINGS.same for way in kept):
                kept.append(ways[index])
        return kept

    def expect(self, way: Array, scale: Scale) -> None:
        """What is likely of ways counts from here on, as much as is due to it by what `way` leaves."""
        self._price = 0.0
        left = self._power + self.cost(way, scale)[0]
        self._price = max(left, SETTINGS.least_left) / self._independent


@dataclass(frozen=True)
class ShakenPhoto:
    """A photo whose way is sought, with the picture that it would be without motion.

    Attributes:
        still, photo, counts: as of `Alike.of`.
        straight: px that the photo's way is likely to be long.
        likely, independent: as of `ExplainedPhoto`.
    """

    still: Tensor
    photo: Tensor
    counts: Tensor | None
    straight: float
    likely: Array
    independent: float

    def averaged(self, step: int) -> ShakenPhoto:
        """The same on a grid of `step` px."""
        still, photo = (torch.nn.functional.avg_pool2d(planes, step) for planes in (self.still, self.photo))
        counts = None if self.counts is None else torch.nn.functional.avg_pool2d(self.counts[None].float(), step)[0]
        return ShakenPhoto(still, photo, counts, self.straight / step, self.likely / step, self.independent)

    def explained(self) -> ExplainedPhoto:
        """By which ways are compared."""
        s = SETTINGS
        reach = s.least_reach if s.reach * self.straight < s.least_reach else 2 * s.least_reach
        alike = Alike.of(self.still, self.photo, self.counts, reach)
        return ExplainedPhoto(alike, self.likely, self.independent)


def curved_way(shaken: ShakenPhoto, own: Array) -> Array | None:
    """The way that explains a photo better than its own does, if another is found.

    Args:
        own: [2, M + 1] coefficients of the photo's way along x and y, px.

    Returns:
        [2, M + 1] its coefficients; None where what is found is the own one.
    """
    s, step = SETTINGS, max(1, math.ceil(shaken.straight / SETTINGS.longest))
    if step > 1:
        found = curved_way(shaken.averaged(step), own / step)
        return None if found is None else found * step
    explained, coarsest = shaken.explained(), s.coarse * shaken.straight
    halvings = math.ceil(math.log2(max(coarsest / s.fine, 2.0)))
    scales = [explained.scale(coarsest * 0.5**halving) for halving in range(halvings + 1)]
    explained.expect(own.ravel(), scales[-1])
    ways = [explained.followed(start, scales[:1]) for start in _starts(own, s.begin * shaken.straight / 2.0)]
    for scale in scales[1:]:
        ways = [explained.followed(way, [scale]) for way in explained.different(ways, scale)]
    left, best = min(((explained.cost(way, scales[-1])[0], way) for way in ways), key=lambda found: found[0])
    if not left < explained.cost(own.ravel(), scales[-1])[0] - s.nearer or explained.apart(own.ravel(), best) < s.apart:
        return None  # (nor from a picture that is not finite)
    return best.reshape(2, -1)


def _starts(own: Array, half: float) -> list[Array]:
    """Bent ways [2 (M + 1)] of different directions, half as long as 2 `half` px, about the middle of `own`."""
    starts = []
    for turn in range(SETTINGS.directions):
        angle = math.pi * turn / SETTINGS.directions
        for bend in (-SETTINGS.bent * half, SETTINGS.bent * half):
            start = np.zeros_like(own)
            start[:, 0] = own[:, 0]
            start[:, 1] = half * math.cos(angle), half * math.sin(angle)
            start[:, 2] = -bend * math.sin(angle), bend * math.cos(angle)
            starts.append(start.ravel())
    return starts
