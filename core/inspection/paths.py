"""Every photo's own straight path of motion, from its spectrum against the spectrum that all photos share.

A straight path of L px multiplies a photo's power by sinc^2(L f.d), d its direction: dark stripes across the path at
every 1 / L. Photos of one scene have much the same spectrum otherwise, so that

    log P_photo(f) = log C(f) + gain, slope, direction and softness of the photo + log sinc^2(L f.d),

with C common to all (found by turns with the paths) and the noise's power added where the stripes reach it. What all
photos have in common, a blur that all share among it, is in C: a path that all photos share is not seen here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from ..colour import srgb_to_linear
from ..photos.load import Photo
from .noise_level import noise_of

Array = NDArray[np.float64]

#: Polar bins: rings, directions over half a turn, and the highest frequency used (cycles/px).
RINGS, DIRECTIONS, HIGHEST = 44, 24, 0.47
#: The lowest frequency, in periods over the shorter side: below, a photo's spectrum is its own.
PERIODS = 4.0
#: Coefficients of a bin that a path's transfer is averaged over.
POINTS = 12
#: Paths that are tried, px, and directions; the longest is this share of the shorter side.
SHORTEST, FACTOR, TURNS, LONGEST = 1.5, 1.15, 16, 0.12
#: A bin counts where the common spectrum stands so many times above the noise.
LOUD = 6.0
#: What the window leaks into the dark stripes, as a share of the power around them.
LEAK = 0.003
#: How far the log power of one photo's bins scatters around the law, beyond chance.
SCATTER = 0.35
#: Priors on a photo's own slope, direction (2 x), and softness (px^2): standard deviations.
OWN = (0.3, 0.3, 0.3, 5.0)
#: Bins scatter together, so that so many of them say what one would.
TOGETHER = 8.0
#: A path is one where it explains the spectrum better than none by this much (natural log).
CLEAR = 5.0
#: The same for what is taken out of the common spectrum.
SURE = 10.0
#: Photos of one size at least, and bins that stand clear of the noise: fewer tell nothing.
FEWEST, FEWEST_BINS = 4, 100
#: Most rounds of fitting paths and the common spectrum by turns; they end when no path changes. Photos that moved alike
#: take many, as their stripes are in the common spectrum at first.
ROUNDS = 24
#: Largest middle part (px along a side) of a photo that is looked at: more costs time and tells little more.
LARGEST = 1024
#: What the law itself leaves uncertain: of the length a share and px, and degrees.
LAW_SHARE, LAW, LAW_TURN = 0.01, 0.05, 0.5


@dataclass(frozen=True)
class Path:
    """One photo's path.

    Attributes:
        length, error: px, and one standard deviation; length 0 where the path is within its noise.
        angle, angle_error: degrees from x towards y.
        gain: how much better (natural log of the likelihood) the path explains the photo than none.
    """

    length: float = 0.0
    error: float = 0.0
    angle: float = 0.0
    angle_error: float = 180.0
    gain: float = 0.0


@dataclass(frozen=True)
class _Bins:
    """B polar bins of one size of photo.

    Attributes:
        index: [coefficients] bin of each, -1 for none; used: which have one.
        count, f, angle: [B] coefficients, frequency (cycles/px) and direction (radians) of the middle.
        fx, fy: [B, POINTS] some of the coefficients in each.
        window: [H, W] Hann's.
    """

    index: NDArray[np.int64]
    used: NDArray[np.bool_]
    count: Array
    f: Array
    angle: Array
    fx: Array
    fy: Array
    window: Array


@lru_cache(maxsize=2)
def _bins(h: int, w: int) -> _Bins:
    fy, fx = np.broadcast_arrays(np.fft.fftfreq(h)[:, None], np.fft.rfftfreq(w)[None, :])
    radius = np.hypot(fx, fy)
    edges = np.geomspace(PERIODS / min(h, w), HIGHEST, RINGS + 1)
    ring = np.searchsorted(edges, radius, side="right") - 1
    turn = np.floor((np.arctan2(fy, fx) % np.pi) / np.pi * DIRECTIONS + 0.5).astype(int) % DIRECTIONS
    inside = (ring >= 0) & (ring < RINGS)
    flat = np.where(inside, ring * DIRECTIONS + turn, -1).ravel()
    counts = np.bincount(flat[flat >= 0], minlength=RINGS * DIRECTIONS)
    kept = np.flatnonzero(counts > 0)
    number = np.full(RINGS * DIRECTIONS + 1, -1)
    number[kept] = np.arange(len(kept))
    index = number[flat]
    order = np.argsort(index, kind="stable")
    order = order[index[order] >= 0]
    starts = np.concatenate([[0], np.cumsum(counts[kept])[:-1]])
    picks = starts[:, None] + np.floor((np.arange(POINTS) + 0.5) / POINTS * counts[kept][:, None]).astype(int)
    chosen = order[picks]
    x, y = fx.ravel()[chosen], fy.ravel()[chosen]
    middle = np.sqrt(edges[1:] * edges[:-1])[kept // DIRECTIONS]
    window = np.outer(np.hanning(h + 2)[1:-1], np.hanning(w + 2)[1:-1])
    turned = kept % DIRECTIONS * np.pi / DIRECTIONS
    return _Bins(index, index >= 0, counts[kept].astype(float), middle, turned, x, y, window)


def _power(grey: NDArray[np.float32]) -> Array:
    """[B] mean power of the bins."""
    bins = _bins(*grey.shape)
    v = np.asarray(grey, np.float64)
    v = (v - float((v * bins.window).sum() / bins.window.sum())) * bins.window
    power = (np.abs(np.fft.rfft2(v)) ** 2).ravel() / np.square(bins.window).sum()
    sums = np.bincount(bins.index[bins.used], power[bins.used], minlength=len(bins.count))
    return np.asarray(sums / bins.count)


def _transfer(bins: _Bins, length: Array, angle: Array) -> Array:
    """[G, B] share of the power that paths [G] of `length` px along `angle` (radians) leave."""
    out = np.empty((len(length), len(bins.count)))
    for i, (long, turn) in enumerate(zip(length, angle, strict=True)):
        out[i] = (np.sinc(long * (np.cos(turn) * bins.fx + np.sin(turn) * bins.fy)) ** 2).mean(axis=1)
    return out * (1.0 - LEAK) + LEAK


def _light(photo: Photo) -> NDArray[np.float32]:
    """[H, W] linear light, which motion blurs, of the photo's middle; what a mask hides is the rest's mean."""
    height, width = photo.pixels.shape[:2]
    rows, columns = (slice(max(0, (n - LARGEST) // 2), (n + min(n, LARGEST)) // 2) for n in (height, width))
    full = np.float32(np.iinfo(photo.pixels.dtype).max)
    grey = np.asarray(srgb_to_linear(photo.pixels[rows, columns].astype(np.float32) / full), np.float32).mean(axis=2)
    mask = None if photo.mask is None else photo.mask[rows, columns]
    return grey if mask is None or not mask.any() else np.where(mask, grey, grey[mask].mean())


class PathFinder:
    """What photos of one size and scene have in common, against which the path of any of them stands out.

    Args:
        photos: at least `FEWEST`, of one size.
        rounding: standard deviation of the files' rounding, in [0, 1].
    """

    def __init__(self, photos: Sequence[Photo], rounding: float) -> None:
        self._rounding = rounding / 3.0**0.5  # of the mean of three channels
        greys = [_light(photo) for photo in photos]
        height, width = greys[0].shape
        self.bins = _bins(height, width)
        self._independent = np.maximum(self.bins.count / 2.25, 0.5)  # coefficients, under a Hann window
        seen, noise = (np.stack(v) for v in zip(*(self._of(grey) for grey in greys), strict=True))
        common = np.median(np.exp(seen) - noise[:, None], axis=0)
        self.clear = common > LOUD * float(np.median(noise))
        lengths = SHORTEST * FACTOR ** np.arange(60)
        lengths = lengths[lengths < max(LONGEST * min(height, width), 2 * SHORTEST)]
        turns = np.arange(TURNS) * np.pi / TURNS
        self.length = np.append(0.0, np.repeat(lengths, TURNS))
        self.angle = np.append(0.0, np.tile(turns, len(lengths)))
        self.common = np.log(np.maximum(common, 1e-30))
        f, angle = self.bins.f, self.bins.angle
        softness = -4.0 * np.pi**2 * f**2
        # What a photo may have of its own besides a path.
        self._columns = np.stack(
            [np.ones_like(f), np.log(f / 0.1), np.cos(2 * angle), np.sin(2 * angle), softness], axis=1
        )
        self._weight = 1.0 / np.sqrt(polygamma(1, self._independent) + SCATTER**2)
        if self.possible:
            self._table = _transfer(self.bins, self.length, self.angle)
            self._find_common(seen, noise)

    @property
    def possible(self) -> bool:
        """Whether enough of the photos stands clear of their noise."""
        return int(self.clear.sum()) >= FEWEST_BINS

    def path(self, photo: Photo) -> Path:
        """The path of one photo of that size, one of those given or another."""
        if not self.possible:
            return Path()
        seen, noise = self._of(_light(photo))
        own = np.zeros(len(OWN) + 1)
        for _ in range(3):
            cost, owns = self._fitted(seen, noise, self._table, own)
            at = int(np.argmin(cost))
            own = owns[at]
        if at == 0:
            return Path()
        length, angle, step, turn = self.length[at], self.angle[at], FACTOR, np.pi / TURNS
        best = cost[at]
        for _ in range(3):
            ls, ts = length * step ** np.linspace(-1, 1, 5), angle + turn * np.linspace(-1, 1, 5)
            cells = [grid.ravel() for grid in np.meshgrid(ls, ts)]
            fine, _ = self._fitted(seen, noise, _transfer(self.bins, *cells), own)
            at = int(np.argmin(fine))
            length, angle, best = cells[0][at], cells[1][at], fine[at]
            step, turn = step**0.5, turn / 2
        gain = float(cost[0] - best)
        sd, sa = self._errors(seen, noise, length, angle, own)
        found = length if gain > CLEAR and length > 2.0 * sd else 0.0
        return Path(float(found), sd, math.degrees(angle) % 180.0, sa, gain)

    def _of(self, grey: NDArray[np.float32]) -> tuple[Array, float]:
        """[B] log power without what chance does to it, and the noise's power."""
        k = self._independent
        noise = noise_of(grey, self._rounding) ** 2
        return np.log(np.maximum(_power(grey), 1e-30)) - (digamma(k) - np.log(k)), noise

    def _fitted(self, seen: Array, noise: float, table: Array, own: Array) -> tuple[Array, Array]:
        """Minus log likelihood [G] of paths that leave `table` [G, B], and the photo's coefficients [G, 5] then.

        `own` [5] is where the law is made linear: a photo much softer than the others drowns earlier in its noise.
        """
        keep = self.clear
        signal = np.exp(self.common + self._columns @ own)[keep]
        rest = seen[keep] - np.log(signal * table[:, keep] + noise)
        a = self._columns[keep] * (signal / (signal + noise) * self._weight[keep])[:, None]
        prior = np.diag([0.0, *(1.0 / s**2 for s in OWN)])
        change = ((rest * self._weight[keep]) @ a - own @ prior) @ np.linalg.inv(a.T @ a + prior)
        left = rest * self._weight[keep] - change @ a.T
        # Student's t of four degrees: single bins may be far off.
        cost = (2.5 * np.log1p(left**2 / 4.0)).sum(axis=1) / TOGETHER
        return np.asarray(cost + 0.5 * (np.square(own + change) @ prior).sum(axis=1)), np.asarray(own + change)

    def _find_common(self, seen: Array, noise: Array) -> None:
        own, found = np.zeros((len(seen), len(OWN) + 1)), np.full(len(seen), -1)
        sharp, weight = np.zeros_like(seen), np.zeros_like(seen)
        first = self.common
        for _ in range(ROUNDS):
            before = found.copy()
            for i, (one, own_noise) in enumerate(zip(seen, noise, strict=True)):
                # Without the photo itself, whose own stripes would explain themselves.
                rest = weight.sum(axis=0) - weight[i]
                others = ((sharp * weight).sum(axis=0) - sharp[i] * weight[i]) / np.maximum(rest, 1e-9)
                self.common = np.where(rest > 0.1, others, first)
                cost, owns = self._fitted(one, own_noise, self._table, own[i])
                # A path that all photos share is as good as none: whatever is not clearly a photo's own is none.
                found[i] = np.argmin(cost) if cost[0] - cost.min() > SURE else 0
                left, own[i] = self._table[found[i]], owns[found[i]]
                above = np.maximum(np.exp(one) - own_noise, 1e-30)
                sharp[i] = np.log(above) - self._columns @ own[i] - np.log(left)
                weight[i] = left / (left + 0.1) * (above > 0.5 * own_noise)
            if (found == before).all():
                break
        total = weight.sum(axis=0)
        # A bin that is in all photos' stripes keeps what was known of it.
        self.common = np.where(total > 0.1, (sharp * weight).sum(axis=0) / np.maximum(total, 1e-9), first)

    def _errors(self, seen: Array, noise: float, length: float, angle: float, own: Array) -> tuple[float, float]:
        """Standard deviations of length (px) and angle (degrees): the posterior's, on a grid as fine as that."""
        wide, turned, sd, sa = 0.3 * length, math.radians(30.0), 0.0, 0.0
        for _ in range(4):
            cells = np.meshgrid(length + wide * np.linspace(-1, 1, 9), angle + turned * np.linspace(-1, 1, 9))
            ls, ts = (grid.ravel() for grid in cells)
            cost, _ = self._fitted(seen, noise, _transfer(self.bins, ls, ts), own)
            share = np.exp(cost.min() - cost)
            share /= share.sum()
            sd = float(np.sqrt((share * (ls - length) ** 2).sum()))
            sa = float(np.sqrt((share * (ts - angle) ** 2).sum()))
            narrow = sd < 0.25 * wide, sa < 0.25 * turned
            if not any(narrow):
                break
            wide, turned = wide * (0.25 if narrow[0] else 1.0), turned * (0.25 if narrow[1] else 1.0)
        return math.hypot(sd, LAW_SHARE * length, LAW), math.hypot(math.degrees(sa), LAW_TURN)


def find_paths(photos: Sequence[Photo], rounding: float, common: PathFinder | None = None) -> dict[str, Path]:
    """Paths by photo name, of all photos whose size enough others share.

    Args:
        common: for photos of the size that most have; found from all of them if None.
    """
    out: dict[str, Path] = {}
    sizes = [photo.size for photo in photos]
    for size in sorted(set(sizes)):
        same = [photo for photo in photos if photo.size == size]
        if len(same) >= FEWEST:
            usual = common is not None and sizes.count(size) == max(sizes.count(s) for s in sizes)
            finder = common if usual and common is not None else PathFinder(same, rounding)
            out.update({photo.name: finder.path(photo) for photo in same})
    return out
