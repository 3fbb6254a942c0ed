"""The width of a line that a blur has smeared, by what photos say of it: no picture is sharpened for it.

Between its two edges lies one level, outside two others, and on these a texture that is not known. It is taken
for a Gaussian process whose covariance falls with the distance r as exp(-r / l): that of patches with sharp borders,
and of most surfaces where they are magnified. Through the blur, profiles across the line are Gaussian, too, so that
each width has a likelihood in which every texture has been thought of (Rasmussen and Williams 2006, ch. 2 and 5).

Light along the line is split into cosines. The constant one holds line and texture; the others, as the line is straight
and of one colour, only texture: they say how strong it is right there, whatever the line does. The same likelihood
finds strength and length of the texture, and the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.linalg import toeplitz
from scipy.optimize import minimize

from ..evaluation.edges import fit_width
from ..numbers import BY_DEFINITION, number
from .line_spread import LineSpread

Array = NDArray[np.float64]
#: More than any squared row: what is left of it in the corner of a bordered covariance is positive.
_BEYOND_ALL = 1e30
#: Covariances: those of a guess, and of three beside it.
_KEPT = 4
_CHOSEN_ON = "lines of 4 to 16 px on four grounds, through 5 px (benchmarks/lined_wall.py, seed 0)"
_CHECKED_ON = "the same through 2 and 3 px, and another wall (seed 1): 94 % of 384 intervals hold; through 8 px 86 %"


@dataclass(frozen=True)
class LineFitSettings:
    """What is believed of a line and its surroundings before a photo is looked at. Levels are of 1: white."""

    cosines: int = number(
        6,
        "count",
        "along the line, the constant among them; with 2 the texture of a mosaic is held for the line (errors of 16"
        " instead of 5 %), with 4 for 7 %",
        _CHOSEN_ON,
        _CHECKED_ON,
    )
    level: float = number(0.5, "of 1", "usual level of a line or a surface", BY_DEFINITION)
    spread: float = number(
        0.3, "of 1", "standard deviation of levels: no line is darker than black, or it could be as thin as it likes"
    )
    length: float = number(6.0, "px", "usual length of a texture; a factor of e either way is one standard deviation")
    lengths: tuple[float, ...] = number(
        (1.5, 3.0, 6.0, 12.0, 24.0, 48.0), "px", "that covariances are computed for, and taken between"
    )
    noise: float = number(
        0.001, "of 1", "least noise of a profile: below it searches follow what no model holds", _CHOSEN_ON, _CHECKED_ON
    )
    most_noise: float = number(0.05, "of 1", "largest noise of a profile")
    even: float = number(0.01, "share", "of the strongest texture's variance that each colour has at least")
    turned: float = number(0.1, "tangent", "standard deviation of a line from the upright of the two points beside it")
    texture: tuple[float, float] = number(
        (0.01, 100.0), "of the photo's", "weakest and strongest texture before the blur"
    )
    first_textures: tuple[float, ...] = number((2.0, 8.0), "as of texture", "strengths that searches begin from")
    first_lengths: tuple[float, ...] = number((3.0, 10.0), "px", "lengths of texture that searches begin from")
    first_widths: int = number(12, "count", "widths that are tried before the search, evenly in their logarithms")
    searches: int = number(2, "count", "that begin at the best of these, about each of two middles")
    iterations: int = number(60, "count", "of a search, at most")
    again: int = number(8, "count", "of those that find the rest anew for another width")
    doubted: float = number(
        1.3,
        "factor",
        "of the standard deviation: no texture is quite what it is taken for; without it 89 % of 64 intervals hold",
        _CHOSEN_ON,
        _CHECKED_ON,
    )
    plain: float = number(
        2.0, "in the logarithm", "of the likelihood that a line must gain over texture alone, to be one", BY_DEFINITION
    )
    narrowest: float = number(0.5, "px", "that is asked for")
    cell: float = number(5.0, "per standard deviation of the blur", "cells of the texture, of 0.25 to 1 px")
    stride: float = number(0.7, "standard deviations", "between widths whose likelihood is found")
    strides: int = number(8, "count", "to either side, at most")
    unlikely: float = number(4.0, "in the logarithm", "of the likelihood lost, where these end: 0.02 of the best")


SETTINGS = LineFitSettings()


@dataclass(frozen=True)
class LineFit:
    """How wide a line is.

    Attributes:
        width: mean of the widths as likely as they are, px; deviation: what they scatter by, and `doubted`.
        levels: [3, 3] before, in and behind the line, of each colour.
    """

    width: float
    deviation: float
    levels: Array = field(repr=False)


@dataclass(frozen=True)
class LineGuess:
    """Middle and width (px) of a line; the logarithms of strength and length (px) of the texture, and of the noise.

    The strength is that before the blur, in units of what the photos show of it along the line.
    """

    middle: float
    width: float
    texture: float
    length: float
    noise: float


def cosines_along(count: int) -> Array:
    """[K, count] weights whose sums over `count` profiles, 1 px apart, are the cosines along the line.

    The first is the mean; all have the same noise.
    """
    places = (np.arange(count) + 0.5) / count
    waves = [np.sqrt(2.0) * np.cos(np.pi * k * places) for k in range(1, min(SETTINGS.cosines, count))]
    return np.stack([np.ones(count), *waves]) / count


class LineLikelihood:
    """Of profiles across a line.

    Colours are turned so that no texture of one goes with that of another. Strengths are in units of theirs.

    Args:
        places: [N] px across the line; block: [N, L, 3] L profiles 1 px apart.
        spread: of the blur.
    """

    def __init__(self, places: Array, block: Array, spread: LineSpread) -> None:
        self.places, self.spread, self.count = places, spread, block.shape[1]
        self.colours, self.textures = _textured_colours(block)
        waves = cosines_along(self.count)
        self.profiles = np.einsum("kl,nlc,cd->knd", waves, block - SETTINGS.level, self.colours)
        self.cell = float(np.clip(spread.across / SETTINGS.cell, 0.25, 1.0))
        reach = np.ceil(3.5 * spread.across)
        self.cells = np.arange(places[0] - reach, places[-1] + reach + self.cell, self.cell)
        self._blurs = spread.line(places[:, None] - self.cells) * self.cell
        self._moments = waves @ (np.arange(self.count) - (self.count - 1) / 2)
        distances = np.arange(len(self.cells)) * self.cell
        self._sharp = [
            np.stack([toeplitz(row) for row in _covariances(distances, waves, spread.along, length)])
            for length in SETTINGS.lengths
        ]
        self._half = [self._blurs @ sharp for sharp in self._sharp]
        self._whole = [half @ self._blurs.T for half in self._half]
        self._kept: dict[tuple[float, ...], Array] = {}

    def loss(self, guess: LineGuess) -> float:
        """Minus the logarithm of the likelihood of a guess (and of how usual its texture's length is)."""
        usual = 0.5 * (guess.length - float(np.log(SETTINGS.length))) ** 2
        covariance = self._covariance(guess)
        try:
            first = self._levels(covariance[0], guess)
            logs, white = whitened(covariance[1:], self.profiles[1:].transpose(0, 2, 1)[:, :, None])
        except np.linalg.LinAlgError:
            return float("inf")
        return usual + first.loss + float(logs.sum()) + 0.5 * float(np.vdot(white, white))

    def levels(self, guess: LineGuess) -> Array:
        """[3, 3] most likely levels before, in and behind the line, of each colour of the photos."""
        found = self._levels(self._covariance(guess)[0], guess).found
        return np.asarray(SETTINGS.level + found.T @ self.colours.T)

    def middle(self) -> float:
        """px where the blurred photo has the line's middle: between its flanks, or its centre of mass."""
        mean = self.profiles[0] @ self.colours.T
        ends = mean[np.abs(self.places) >= self.places[-1] - 1.0].mean(axis=0)
        seen = (mean - ends) @ (mean[np.abs(self.places) <= 1.0].mean(axis=0) - ends)
        flanks = fit_width(self.places, seen)
        if flanks is not None:
            return flanks.middle
        mass = np.maximum(seen, 0.0) ** 2
        return float((mass * self.places).sum() / max(float(mass.sum()), 1e-12))

    def slope(self, guess: LineGuess) -> float:
        """px that the line moves across for each px along it, about 0: the line's share in the other cosines."""
        aside = 0.05
        moved = [self._shapes(replace(guess, middle=guess.middle + way * aside)) / (2 * aside) for way in (-1.0, 1.0)]
        levels = (self.levels(guess) - SETTINGS.level) @ self.colours
        falls = (moved[1] - moved[0]) @ levels
        moved_by = self._moments[1:, None, None] * falls.T
        both = np.stack([moved_by, self.profiles[1:].transpose(0, 2, 1)], axis=2)
        _, white = whitened(self._covariance(guess)[1:], both)
        seen, strength = (float(np.vdot(white[:, :, 0], white[:, :, k])) for k in (1, 0))
        return seen / (SETTINGS.turned**-2 + strength)

    def _levels(self, covariance: Array, guess: LineGuess) -> _Levels:
        """The levels of the constant cosine, whose covariance [3, N, N] is given."""
        shapes = np.broadcast_to(self._shapes(guess).T, (3, 3, len(self.places)))
        logs, white = whitened(covariance, np.concatenate([shapes, self.profiles[0].T[:, None]], axis=1))
        shapes, profile = white[:, :3], white[:, 3]
        precision = shapes @ shapes.transpose(0, 2, 1) + np.eye(3) / SETTINGS.spread**2
        seen = np.einsum("csn,cn->cs", shapes, profile)
        found = np.linalg.solve(precision, seen[:, :, None])[:, :, 0]
        explained = float(np.vdot(profile, profile) - np.vdot(seen, found))
        return _Levels(found, float(logs.sum()) + 0.5 * (explained + float(np.linalg.slogdet(precision)[1].sum())))

    def _shapes(self, guess: LineGuess) -> Array:
        """[N, 3] how much of each place's light is from before, in and behind the line."""
        before = self.spread.edge(guess.middle - guess.width / 2 - self.places)
        behind = self.spread.edge(self.places - guess.middle - guess.width / 2)
        return np.stack([before, 1.0 - before - behind, behind], axis=1)

    def _covariance(self, guess: LineGuess) -> Array:
        """[K, 3, N, N] of each cosine's profile in each colour: texture outside the line, blurred, and noise."""
        strength = (float(np.exp(guess.texture)) * self.textures[:, None, None]) ** 2
        noise = np.eye(len(self.places)) * float(np.exp(2 * guess.noise))
        outside = self._outside(guess.middle, guess.width, guess.length)
        return np.asarray(outside[:, None] * strength + noise)

    def _outside(self, *of: float) -> Array:
        """`_outside_anew`, or what was found before: a search's differences by strength and noise ask for it again."""
        if of not in self._kept:
            if len(self._kept) == _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[of] = self._outside_anew(*of)
        return self._kept[of]

    def _outside_anew(self, middle: float, width: float, length: float) -> Array:
        """[K, N, N] the covariance of a texture of strength 1 without what lies in the line, through the blur.

        Only the line's few cells are computed anew; linear between lengths in their logarithms.
        """
        edges = middle - width / 2, middle + width / 2
        left, right = self.cells - self.cell / 2, self.cells + self.cell / 2
        inside = np.clip((np.minimum(right, edges[1]) - np.maximum(left, edges[0])) / self.cell, 0.0, 1.0)
        at = float(np.interp(length, np.log(SETTINGS.lengths), np.arange(len(SETTINGS.lengths))))
        first = min(int(at), len(SETTINGS.lengths) - 2)
        share = at - first
        cells = np.flatnonzero(inside)
        within = slice(int(cells[0]), int(cells[-1]) + 1) if len(cells) else slice(0, 0)

        def between(kept: list[Array], *where: slice) -> Array:
            chosen = (slice(None), *where)
            return np.asarray((1.0 - share) * kept[first][chosen] + share * kept[first + 1][chosen])

        hidden = self._blurs[:, within] * inside[within]
        crossed = hidden @ between(self._half, slice(None), within).transpose(0, 2, 1)
        twice = hidden @ between(self._sharp, within, within) @ hidden.T
        return np.asarray(between(self._whole) - crossed - crossed.transpose(0, 2, 1) + twice)


@dataclass(frozen=True)
class _Levels:
    """Most likely levels [3 colours, 3] about the usual one, and the loss with all levels thought of."""

    found: Array
    loss: float


def whitened(covariance: Array, rows: Array) -> tuple[Array, Array]:
    """Rows as seen where their covariance is one.

    A Cholesky decomposition of the covariance bordered by the rows has both L and L^-1 of the rows: one call for all.

    Args:
        covariance: [..., N, N]; rows: [..., R, N].

    Returns:
        [..., N] natural logarithms of the diagonal of L, and [..., R, N] L^-1 of each row.

    Raises:
        numpy.linalg.LinAlgError: a covariance is not positive.
    """
    size, more = rows.shape[-1], rows.shape[-2]
    bordered = np.zeros((*covariance.shape[:-2], size + more, size + more))
    bordered[..., :size, :size] = covariance
    bordered[..., size:, :size] = rows
    corner = np.arange(size, size + more)
    bordered[..., corner, corner] = _BEYOND_ALL
    root = np.linalg.cholesky(bordered)
    return np.log(np.diagonal(root, axis1=-2, axis2=-1)[..., :size]), root[..., size:, :size]


def _covariances(distances: Array, waves: Array, blur: float, length: float) -> list[Array]:
    """Of each cosine along the line: covariance of a texture of strength 1 with itself [D] px across, blurred along."""
    count = waves.shape[1]
    both = np.sqrt(2.0) * blur  # (of the two profiles whose product it is)
    along = np.arange(-(count + 5 * both), count + 5 * both + 0.5, 0.5)
    lags = np.arange(1 - count, count)
    weights = np.exp(-0.5 * ((along[:, None] - lags) / both) ** 2)
    blurred = np.exp(-np.hypot(distances[:, None], along) / length) @ (weights / weights.sum(axis=0))
    return [blurred @ np.correlate(wave, wave, "full") for wave in waves]


def _textured_colours(block: Array) -> tuple[Array, Array]:
    """[3, 3] unit directions of colour whose textures have nothing to do with each other, and [3] their strengths."""
    rest = (block - block.mean(axis=1, keepdims=True)).reshape(-1, 3)
    strengths, directions = np.linalg.eigh(rest.T @ rest / len(rest))
    # behind a blur neighbours are alike but for the noise: of a second difference, 1 + 4 + 1 variances
    bent = np.diff(block, 2, axis=0).reshape(-1, 3) @ directions
    texture = np.maximum(strengths - (bent**2).mean(axis=0) / 6, 0.0)
    return directions, np.sqrt(np.maximum(texture, SETTINGS.even * texture.max() + SETTINGS.noise**2))


def first_slope(block: Array, spread: LineSpread) -> float:
    """px that a line moves across for each px along it, of [N, L, 3] profiles, before anything else is known of it.

    Least squares of the first order, drawn to 0 as far as what else the photo shows along the line can turn it.
    """
    beside = np.arange(block.shape[1]) - (block.shape[1] - 1) / 2
    mean = block.mean(axis=1, keepdims=True)
    falls, rest = -np.gradient(mean, axis=0) * beside[:, None], block - mean
    strength = float((falls**2).sum())
    moved = float((falls * rest).sum())
    alike = 4 * np.pi * spread.across * spread.along  # (px that the blur makes one)
    error = float((rest**2).mean()) * alike
    return moved / max(strength + error / SETTINGS.turned**2, 1e-12)


def is_line(likelihood: LineLikelihood, best: LineGuess, widest: float) -> bool:
    """Whether a line says more than a texture alone, or a step between two."""
    alone = _loss_at(likelihood, best, SETTINGS.narrowest / 100, widest)[0]
    return alone - likelihood.loss(best) > SETTINGS.plain


def fit_line(likelihood: LineLikelihood, best: LineGuess, widest: float) -> LineFit:
    """All widths that are as likely as the best line's.

    Args:
        best: of `best_line`.
        widest: px that it may be wide.
    """
    width, deviation = _as_likely(likelihood, best, likelihood.loss(best), widest)
    return LineFit(width, SETTINGS.doubted * deviation, likelihood.levels(best))


def _bounds(widest: float) -> list[tuple[float, float]]:
    """Of middle, texture, length and noise."""
    logs = [np.log(pair) for pair in (SETTINGS.texture, SETTINGS.lengths, (SETTINGS.noise, SETTINGS.most_noise))]
    return [(-widest / 4, widest / 4), *((float(pair[0]), float(pair[-1])) for pair in logs)]


def best_line(likelihood: LineLikelihood, widest: float, start: LineGuess | None = None) -> LineGuess:
    """The most likely line.

    Args:
        widest: px that it may be wide; start: of the search; None to seek from the best of many.
    """
    starts = _starts(likelihood, widest) if start is None else [start]
    found = [_searched(likelihood, guess, widest) for guess in starts]
    return min(found, key=likelihood.loss)


def _starts(likelihood: LineLikelihood, widest: float) -> list[LineGuess]:
    """The best guesses of some widths, about where the points were set and where the blurred photo has the line."""
    noise, best = float(np.log(1.5 * SETTINGS.noise)), list[LineGuess]()
    for middle in (0.0, float(np.clip(likelihood.middle(), -widest / 4, widest / 4))):
        tried = []
        for width in np.geomspace(1.5, max(3.0, 0.9 * widest), SETTINGS.first_widths):
            guesses = [
                LineGuess(middle, float(width), float(np.log(strength)), float(np.log(length)), noise)
                for strength in SETTINGS.first_textures
                for length in SETTINGS.first_lengths
            ]
            tried.append(min(((likelihood.loss(guess), guess) for guess in guesses), key=lambda one: one[0]))
        best += [guess for _, guess in sorted(tried, key=lambda one: one[0])[: SETTINGS.searches]]
    return best


def _searched(likelihood: LineLikelihood, start: LineGuess, widest: float) -> LineGuess:
    middle, *rest = _bounds(widest)
    widths = (float(np.log(SETTINGS.narrowest)), float(np.log(widest)))
    end = minimize(
        lambda x: likelihood.loss(LineGuess(x[0], float(np.exp(x[1])), x[2], x[3], x[4])),
        [start.middle, np.log(start.width), start.texture, start.length, start.noise],
        method="L-BFGS-B",
        bounds=[middle, widths, *rest],
        options={"maxiter": SETTINGS.iterations},
    )
    x = [float(value) for value in end.x]
    return LineGuess(x[0], float(np.exp(x[1])), x[2], x[3], x[4])


def _as_likely(likelihood: LineLikelihood, best: LineGuess, loss: float, widest: float) -> tuple[float, float]:
    """Mean and standard deviation of the widths, each as likely as the best line of that width."""
    aside = 0.05 * best.width
    curved = max(2 * (_loss_at(likelihood, best, best.width + aside, widest)[0] - loss) / aside**2, 1e-4)
    stride = SETTINGS.stride * min(curved**-0.5, 0.4 * best.width)
    widths, losses = [best.width], [loss]
    for way in (-1, 1):
        guess = best
        for count in range(1, SETTINGS.strides + 1):
            width = best.width + way * count * stride
            if not SETTINGS.narrowest <= width <= widest:
                break
            lost, guess = _loss_at(likelihood, guess, width, widest)
            widths.append(width)
            losses.append(lost)
            if lost > loss + SETTINGS.unlikely:
                break
    order = np.argsort(widths)
    x, y = np.array(widths)[order], np.array(losses)[order]
    fine = np.linspace(x[0], x[-1], 401)
    curve = PchipInterpolator(x, y)(fine) if len(x) > 1 else np.zeros(len(fine))
    share = np.exp(curve.min() - curve)
    mean = float((share * fine).sum() / share.sum())
    return mean, float(np.sqrt((share * (fine - mean) ** 2).sum() / share.sum()))


def _loss_at(likelihood: LineLikelihood, guess: LineGuess, width: float, widest: float) -> tuple[float, LineGuess]:
    """The loss of a line of that width, everything else found anew."""
    end = minimize(
        lambda x: likelihood.loss(LineGuess(x[0], width, x[1], x[2], x[3])),
        [guess.middle, guess.texture, guess.length, guess.noise],
        method="L-BFGS-B",
        bounds=_bounds(widest),
        options={"maxiter": SETTINGS.again},
    )
    x: Sequence[float] = [float(value) for value in end.x]
    return float(end.fun), replace(guess, middle=x[0], width=width, texture=x[1], length=x[2], noise=x[3])
