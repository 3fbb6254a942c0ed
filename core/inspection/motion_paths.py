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
from ..compiled import run
from ..imaging.spectral_bins import SpectralBins, frequency_plane, polar_index
from ..numbers import BY_DEFINITION, number
from ..photos.load import Photo
from .evidence import judged
from .noise_level import noise_of
from .path_kernels import straight_shares

Array = NDArray[np.float64]

_DRAWN = "drawn scenes of benchmarks/effect_scenes.py"
_CHECKED = "benchmarks/effects.py (other drawn scenes of the same kind); no real photos with known motion"


@dataclass(frozen=True)
class MotionPathSettings:
    """Numbers of the estimate of every photo's own path."""

    smallest_visible: float = number(
        3.0,
        "px",
        "length of a path (rms over the photos) that shows in a twin",
        "judgement of what shows in a twin; set once, before benchmarks/effects.py was run",
        _CHECKED,
    )
    surely: float = number(
        5.0,
        "standard errors",
        "above the smallest visible, from which on spectra show motion beyond doubt: a trial need not confirm it, as"
        " one of few steps may see nothing in photos from far apart",
        "sharp photos of the room, blurred along paths of 4 to 16 px: 10, trial 0.13 +- 0.09 dB, whole run 1.1 dB",
        "no motion is called for on 11 sharp sets and drawn ones without it (benchmarks/false_alarms.py)",
    )
    surely_moved: float = number(
        0.2,
        "share of the photos",
        "whose own paths are so much longer that it is beyond doubt, too: one uncertain path makes the rms uncertain",
        "photos shaken by 4 to 20 px along twins of copr and banana: 0.29 and 0.38, the same standing still: none",
        "likewise brighton, drinks, lego, copr again: 0.29 to 0.54; none in 25 sharp, evenly blurred, defocused sets",
    )
    unseen: float = number(
        0.3, "px", "what the lengths of a whole set leave uncertain: paths of 1 or 2 px are neither seen nor excluded"
    )
    rings: int = number(44, "count", "polar bins of the spectrum, by frequency", _DRAWN, _CHECKED)
    directions: int = number(24, "count", "polar bins over half a turn", _DRAWN, _CHECKED)
    highest: float = number(0.47, "cycles/px", "highest frequency used: beyond, demosaicking and sharpening rule")
    lowest_periods: float = number(
        4.0, "periods", "over the shorter side, of the lowest frequency: below, a photo's spectrum is its own"
    )
    samples: int = number(12, "count", "coefficients of a bin that a path's transfer is averaged over")
    shortest: float = number(1.5, "px", "shortest path that is tried")
    factor: float = number(1.15, "ratio", "of one length that is tried to the next shorter one")
    turns: int = number(16, "count", "directions that are tried")
    longest_share: float = number(0.12, "share of the shorter side", "longest path that is tried")
    clear_of_noise: float = number(6.0, "ratio", "of the common power to the noise's from which on a bin counts")
    leak: float = number(0.003, "share", "of the power around them that the window leaks into the dark stripes", _DRAWN)
    scatter: float = number(
        0.35, "natural log", "scatter of one photo's bins around the law, beyond chance", _DRAWN, _CHECKED
    )
    prior_spreads: tuple[float, float, float, float] = number(
        (0.3, 0.3, 0.3, 5.0),
        "exponent, log, log, px^2",
        "of a photo's own slope, direction (2 x), and softness",
        _DRAWN,
    )
    farthest_gain: float = number(
        10.0,
        "natural log",
        "that a photo's power may be from the others', either way: a black photo among them says nothing of any path",
        BY_DEFINITION,
    )
    bins_together: float = number(8.0, "count", "bins that say what one would, as they scatter together", _DRAWN)
    clear_gain: float = number(
        5.0, "natural log", "of the likelihood that a path must gain over none", _DRAWN, _CHECKED
    )
    sure_gain: float = number(10.0, "natural log", "the same for what is taken out of the common spectrum", _DRAWN)
    fewest_photos: int = number(4, "count", "photos of one size at least: fewer have no common spectrum")
    fewest_bins: int = number(100, "count", "bins clear of the noise at least, of all photos together and of one")
    rounds: int = number(
        24,
        "count",
        "of fitting paths and the common spectrum by turns at most; they end when no path changes. Photos that moved "
        "alike take many, as their stripes are in the common spectrum at first",
    )
    largest_side: int = number(
        1024, "px", "of the photo's middle part that is looked at: more costs time and says little more"
    )
    law_share: float = number(0.01, "share", "of a length: what the law itself leaves uncertain", _DRAWN)
    law: float = number(0.05, "px", "the same, whatever the length", _DRAWN)


SETTINGS = MotionPathSettings()


@dataclass(frozen=True)
class MotionPath:
    """One photo's path.

    Attributes:
        length, error: px, and one standard deviation; length 0 where the path is within its noise.
        angle: degrees from x towards y.
        gain: how much better (natural log of the likelihood) the path explains the photo than none.
    """

    length: float = 0.0
    error: float = 0.0
    angle: float = 0.0
    gain: float = 0.0


@dataclass(frozen=True)
class SetMotion:
    """The paths of a set of photos together.

    Attributes:
        length, error: rms over the photos, px, with its standard deviation.
        paths: by photo.
    """

    length: float
    error: float
    paths: dict[str, MotionPath]

    @property
    def lengths(self) -> dict[str, float]:
        """px by photo, 0 where the path is within its noise."""
        return {name: path.length for name, path in self.paths.items()}

    @property
    def significant(self) -> bool:
        """Whether it is larger than the smallest visible."""
        return judged("motion", self.length, self.error, SETTINGS.smallest_visible, "px", "").needed

    @property
    def certain(self) -> bool:
        """Whether it is so beyond doubt, by all photos together or by many of them, each for itself."""
        moved = sum(_surely(path) for path in self.paths.values())
        return _surely(self) or moved > SETTINGS.surely_moved * len(self.paths)


def _surely(path: MotionPath | SetMotion) -> bool:
    """Whether a length is beyond doubt larger than the smallest visible."""
    return path.length - SETTINGS.smallest_visible > SETTINGS.surely * path.error


@dataclass(frozen=True)
class _Bins:
    """B polar bins of one size of photo.

    Attributes:
        spectral: which coefficient belongs to which bin.
        count, f, angle: [B] coefficients, frequency (cycles/px) and direction (radians) of the middle.
        fx, fy: [B, samples] some of the coefficients in each.
    """

    spectral: SpectralBins
    count: Array
    f: Array
    angle: Array
    fx: Array
    fy: Array


@lru_cache(maxsize=2)
def _bins(h: int, w: int) -> _Bins:
    fy, fx = np.broadcast_arrays(*frequency_plane(h, w))
    edges = np.geomspace(SETTINGS.lowest_periods / min(h, w), SETTINGS.highest, SETTINGS.rings + 1)
    flat = polar_index(h, w, edges, SETTINGS.directions).ravel()
    counts = np.bincount(flat[flat >= 0], minlength=SETTINGS.rings * SETTINGS.directions)
    kept = np.flatnonzero(counts > 0)
    number = np.full(SETTINGS.rings * SETTINGS.directions + 1, -1)
    number[kept] = np.arange(len(kept))
    index = number[flat]
    order = np.argsort(index, kind="stable")
    order = order[index[order] >= 0]
    starts = np.concatenate([[0], np.cumsum(counts[kept])[:-1]])
    picks = starts[:, None] + np.floor(
        (np.arange(SETTINGS.samples) + 0.5) / SETTINGS.samples * counts[kept][:, None]
    ).astype(int)
    chosen = order[picks]
    x, y = fx.ravel()[chosen], fy.ravel()[chosen]
    middle = np.sqrt(edges[1:] * edges[:-1])[kept // SETTINGS.directions]
    turned = kept % SETTINGS.directions * np.pi / SETTINGS.directions
    spectral = SpectralBins((h, w), index, len(kept))
    return _Bins(spectral, counts[kept].astype(float), middle, turned, x, y)


def _power(grey: NDArray[np.float32]) -> Array:
    """[B] mean power of the bins."""
    return _bins(*grey.shape).spectral.power_of(grey)


def _transfer(bins: _Bins, length: Array, angle: Array) -> Array:
    """[G, B] share of the power that paths [G] of `length` px along `angle` (radians) leave."""
    out = np.empty((len(length), len(bins.count)))
    run(straight_shares, len(out), length * np.cos(angle), length * np.sin(angle), bins.fx, bins.fy, out, grain=8)
    return out * (1.0 - SETTINGS.leak) + SETTINGS.leak


def _light(photo: Photo) -> NDArray[np.float32]:
    """[H, W] linear light, which motion blurs, of the photo's middle; what a mask hides is the rest's mean."""
    height, width = photo.pixels.shape[:2]
    rows, columns = (
        slice(max(0, (n - SETTINGS.largest_side) // 2), (n + min(n, SETTINGS.largest_side)) // 2)
        for n in (height, width)
    )
    full = np.float32(np.iinfo(photo.pixels.dtype).max)
    grey = np.asarray(srgb_to_linear(photo.pixels[rows, columns].astype(np.float32) / full), np.float32).mean(axis=2)
    mask = None if photo.mask is None else photo.mask[rows, columns]
    return grey if mask is None or not mask.any() else np.where(mask, grey, grey[mask].mean())


class MotionPathFinder:
    """What photos of one size and scene have in common, against which the path of any of them stands out.

    Args:
        photos: at least `SETTINGS.fewest_photos`, of one size.
        rounding: standard deviation of the files' rounding, in [0, 1].
    """

    def __init__(self, photos: Sequence[Photo], rounding: float) -> None:
        self.size = photos[0].size
        self._rounding = rounding / 3.0**0.5  # of the mean of three channels
        greys = [_light(photo) for photo in photos]
        height, width = greys[0].shape
        self.bins = _bins(height, width)
        self._independent = np.maximum(self.bins.count / 2.25, 0.5)  # coefficients, under a Hann window
        seen, noise = (np.stack(v) for v in zip(*(self._of(grey) for grey in greys), strict=True))
        common = np.median(np.exp(seen) - noise[:, None], axis=0)
        self.clear = common > SETTINGS.clear_of_noise * float(np.median(noise))
        lengths = SETTINGS.shortest * SETTINGS.factor ** np.arange(60)
        lengths = lengths[lengths < max(SETTINGS.longest_share * min(height, width), 2 * SETTINGS.shortest)]
        turns = np.arange(SETTINGS.turns) * np.pi / SETTINGS.turns
        self.length = np.append(0.0, np.repeat(lengths, SETTINGS.turns))
        self.angle = np.append(0.0, np.tile(turns, len(lengths)))
        self.common = np.log(np.maximum(common, 1e-30))
        f, angle = self.bins.f, self.bins.angle
        softness = -4.0 * np.pi**2 * f**2
        # What a photo may have of its own besides a path.
        self._columns = np.stack(
            [np.ones_like(f), np.log(f / 0.1), np.cos(2 * angle), np.sin(2 * angle), softness], axis=1
        )
        self._weight = 1.0 / np.sqrt(polygamma(1, self._independent) + SETTINGS.scatter**2)
        if self.possible:
            self._table = _transfer(self.bins, self.length, self.angle)
            self._find_common(seen, noise)

    @property
    def possible(self) -> bool:
        """Whether enough of the photos stands clear of their noise."""
        return int(self.clear.sum()) >= SETTINGS.fewest_bins

    def path(self, photo: Photo) -> MotionPath:
        """The path of one photo of that size, one of those given or another."""
        if not self.possible:
            return MotionPath()
        seen, noise = self._of(_light(photo))
        if int((np.exp(seen) > SETTINGS.clear_of_noise * noise).sum()) < SETTINGS.fewest_bins:
            return MotionPath()
        own = np.zeros(len(SETTINGS.prior_spreads) + 1)
        for _ in range(3):
            cost, owns = self._fitted(seen, noise, self._table, own)
            at = int(np.argmin(cost))
            own = owns[at]
        if at == 0:
            return MotionPath()
        length, angle, step, turn = self.length[at], self.angle[at], SETTINGS.factor, np.pi / SETTINGS.turns
        best = cost[at]
        for _ in range(3):
            ls, ts = length * step ** np.linspace(-1, 1, 5), angle + turn * np.linspace(-1, 1, 5)
            cells = [grid.ravel() for grid in np.meshgrid(ls, ts)]
            fine, _ = self._fitted(seen, noise, _transfer(self.bins, *cells), own)
            at = int(np.argmin(fine))
            length, angle, best = cells[0][at], cells[1][at], fine[at]
            step, turn = step**0.5, turn / 2
        gain = float(cost[0] - best)
        sd = self._error(seen, noise, length, angle, own)
        found = length if gain > SETTINGS.clear_gain and length > 2.0 * sd else 0.0
        return MotionPath(float(found), sd, math.degrees(angle) % 180.0, gain)

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
        prior = np.diag([0.0, *(1.0 / s**2 for s in SETTINGS.prior_spreads)])
        change = ((rest * self._weight[keep]) @ a - own @ prior) @ np.linalg.inv(a.T @ a + prior)
        # Far below its noise the law has no slope in the gain any more.
        change[:, 0] = np.clip(change[:, 0], -SETTINGS.farthest_gain - own[0], SETTINGS.farthest_gain - own[0])
        left = rest * self._weight[keep] - change @ a.T
        # Student's t of four degrees: single bins may be far off. (One logarithm of a product for eight of them.)
        together = np.multiply.reduceat(1.0 + left**2 / 4.0, np.arange(0, left.shape[1], 8), axis=1)
        cost = 2.5 * np.log(together).sum(axis=1) / SETTINGS.bins_together
        return np.asarray(cost + 0.5 * (np.square(own + change) @ prior).sum(axis=1)), np.asarray(own + change)

    def _find_common(self, seen: Array, noise: Array) -> None:
        own, found = np.zeros((len(seen), len(SETTINGS.prior_spreads) + 1)), np.full(len(seen), -1)
        sharp, weight = np.zeros_like(seen), np.zeros_like(seen)
        first = self.common
        for _ in range(SETTINGS.rounds):
            before = found.copy()
            for i, (one, own_noise) in enumerate(zip(seen, noise, strict=True)):
                # Without the photo itself, whose own stripes would explain themselves.
                rest = weight.sum(axis=0) - weight[i]
                others = ((sharp * weight).sum(axis=0) - sharp[i] * weight[i]) / np.maximum(rest, 1e-9)
                self.common = np.where(rest > 0.1, others, first)
                cost, owns = self._fitted(one, own_noise, self._table, own[i])
                # A path that all photos share is as good as none: whatever is not clearly a photo's own is none.
                found[i] = np.argmin(cost) if cost[0] - cost.min() > SETTINGS.sure_gain else 0
                left, own[i] = self._table[found[i]], owns[found[i]]
                above = np.maximum(np.exp(one) - own_noise, 1e-30)
                sharp[i] = np.log(above) - self._columns @ own[i] - np.log(left)
                weight[i] = left / (left + 0.1) * (above > 0.5 * own_noise)
            if (found == before).all():
                break
        total = weight.sum(axis=0)
        # A bin that is in all photos' stripes keeps what was estimated of it.
        self.common = np.where(total > 0.1, (sharp * weight).sum(axis=0) / np.maximum(total, 1e-9), first)

    def _error(self, seen: Array, noise: float, length: float, angle: float, own: Array) -> float:
        """Standard deviation (px) of the length: the posterior's, on a grid of lengths and angles as fine as that."""
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
        return math.hypot(sd, SETTINGS.law_share * length, SETTINGS.law)


def find_motion_paths(
    photos: Sequence[Photo], rounding: float, common: MotionPathFinder | None = None
) -> dict[str, MotionPath]:
    """Paths by photo name, of all photos whose size enough others share.

    Args:
        common: for photos of its size; found from all of them if None.
    """
    out: dict[str, MotionPath] = {}
    sizes = [photo.size for photo in photos]
    for size in sorted(set(sizes)):
        same = [photo for photo in photos if photo.size == size]
        if len(same) >= SETTINGS.fewest_photos:
            known = common is not None and common.size == size
            finder = common if known and common is not None else MotionPathFinder(same, rounding)
            out.update({photo.name: finder.path(photo) for photo in same})
    return out


def set_motion(paths: dict[str, MotionPath]) -> SetMotion:
    """What the paths of some photos say of the whole set."""
    squares = np.array([path.length**2 for path in paths.values()])
    length = math.sqrt(float(squares.mean()))
    # Of a mean of squares: twice the length times its error, each, over the root of their number.
    each = np.array([2.0 * path.length * path.error for path in paths.values()])
    own = float(np.sqrt(np.square(each).mean() / len(each))) / (2.0 * max(length, 1.0))
    # A single path says little of a set: what is left without the longest one is as likely.
    alone = length - math.sqrt(float(np.sort(squares)[:-1].mean()))
    return SetMotion(length, math.hypot(own, SETTINGS.unseen, alone), paths)
