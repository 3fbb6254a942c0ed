"""The point spread from a photo of a slanted edge through the medium (ISO 12233).

A straight edge a few degrees off the pixel grid is sampled by its rows at ever other fractions of a pixel, so that
all rows together give its profile four times finer than the pixels. Its derivative, the line spread, is the point
spread seen from the side; one edge shows nothing along itself, so the kernel is taken for round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import least_squares
from scipy.special import ndtr

from ..errors import PsfError
from ..numbers import number
from .kernel import FREQUENCIES, believed, finished, fwhm_of
from .light import PIXEL_VARIANCE, Array, Light
from .measured import MeasuredPsf
from .point import background_of

#: Samples per pixel across the edge (ISO 12233).
FINER = 4


@dataclass(frozen=True)
class EdgePhotoSettings:
    """What a photo of a slanted edge must show."""

    minimum_rise: float = number(
        6.0, "standard deviations of a pixel's noise", "that an edge must rise by to stand out"
    )
    minimum_length: int = number(20, "px", "along the edge; shorter ones have too few rows for finer samples")
    minimum_breadth: float = number(
        3.0, "standard deviations of the blur", "across the edge on each side: nearer to the border it is cut off"
    )
    largest_saturation: float = number(0.01, "share", "of the pixels beside the edge that may be saturated")
    narrow: float = number(0.6, "px", "a narrower blur (sigma) is reported as an upper bound: pixels hide it")
    not_gaussian: float = number(
        0.01, "share of the step", "misfit above which the user is advised to use the kernel file"
    )


SETTINGS = EdgePhotoSettings()


@dataclass(frozen=True)
class EdgeFit:
    """A straight step: n . (x, y) = offset, from its dark to its bright side.

    Attributes:
        normal: angle of the normal, radians from x towards y (down).
        offset: distance of the edge from the origin of pixel indices, px.
        sigma: standard deviation of the step as photographed, px.
        low, high: both levels at the edge's middle.
        mask: [H, W] bool, px used.
        uncertainty: of `sigma`; residual: rms of the fit.
        middle: (column, row) on the edge.
    """

    normal: float
    offset: float
    sigma: float
    low: float
    high: float
    uncertainty: float
    residual: float
    middle: tuple[float, float]
    mask: NDArray[np.bool_] = field(repr=False)

    def distance(self) -> Array:
        """[H, W] signed distance of every pixel's middle from the edge, px."""
        y, x = np.mgrid[: self.mask.shape[0], : self.mask.shape[1]]
        return np.asarray(x * math.cos(self.normal) + y * math.sin(self.normal) - self.offset)

    @property
    def slant(self) -> float:
        """Degrees between the edge and the nearer axis of the pixel grid."""
        turn = math.degrees(self.normal) % 90.0
        return min(turn, 90.0 - turn)


def measure_edge(light: Light) -> MeasuredPsf:
    """The point spread, taken for round, from the clearest straight edge in the photo.

    Raises:
        PsfError: no edge, not straight, not slanted, saturated, or cut off by the border.
    """
    edge = fit_edge_in(light)
    d = edge.distance()
    _check_slant(light, edge, d)
    beside = edge.mask & (np.abs(d) < SETTINGS.minimum_breadth * edge.sigma)
    share = float(light.saturated[beside].mean())
    if share > SETTINGS.largest_saturation:
        raise PsfError(
            f"The edge in '{light.name}' is saturated: {100 * share:.0f} % of the pixels beside it are at the top",
            "Expose shorter, so that the bright side stays below about 90 % of the range",
        )
    sigma = math.sqrt(max(edge.sigma**2 - PIXEL_VARIANCE, 1e-4))
    noise = background_of(light.values)[1]
    structure = believed(edge.residual**2, noise**2, int(edge.mask.sum()))
    mtf = _mtf(light.values, edge, d, structure)
    kernel = _round_kernel(mtf, sigma)
    residual = max(edge.residual**2 - noise**2, 0.0)
    misfit = math.sqrt(residual) / (edge.high - edge.low)
    notes = ["one edge shows the blur across itself only: the kernel is taken for round"]
    if misfit > SETTINGS.not_gaussian:
        notes.append("not a Gaussian: use the kernel file rather than gaussian:SIGMA")
    if sigma < SETTINGS.narrow:
        notes.append("narrower than the pixels can tell: the width is an upper bound")
    place = edge.middle[0] + 0.5, edge.middle[1] + 0.5
    return MeasuredPsf(
        "edge",
        light.space,
        kernel,
        sigma,
        sigma,
        0.0,
        edge.uncertainty * edge.sigma / sigma,
        fwhm_of(kernel),
        misfit,
        FREQUENCIES,
        np.interp(FREQUENCIES, mtf[0], mtf[1]),
        place,
        edge.slant,
        tuple(notes),
    )


def fit_edge_in(light: Light) -> EdgeFit:
    """Finds the clearest edge and fits a Gaussian step to the px around it.

    Raises:
        PsfError: there is none, or too little of it.
    """
    values = light.values
    normal, offset, sigma = _line(light)
    edge: EdgeFit | None = None
    for _ in range(3):
        mask, middle = _band(light, normal, offset, sigma)
        edge = _fit(values, mask, middle, normal, offset, sigma)
        if abs(edge.sigma / sigma - 1.0) < 0.02:
            break
        normal, offset, sigma = edge.normal, edge.offset, edge.sigma
    assert edge is not None
    if edge.high - edge.low < SETTINGS.minimum_rise * max(background_of(values)[1], 0.3 * light.step):
        raise _no_edge(light)
    return edge


def _no_edge(light: Light) -> PsfError:
    return PsfError(
        f"No straight edge stands out in '{light.name}'",
        "Photograph a straight edge between black and white, turned by about 5 degrees, filling most of the"
        " photo; or use --kind point for a point of light",
    )


def _line(light: Light) -> tuple[float, float, float]:
    """Normal (radians), offset and a first standard deviation of the line along which the gradient is strongest."""
    values = light.values
    smooth = 2.0
    gx, gy = (ndimage.gaussian_filter(values, smooth, order=order) for order in ((0, 1), (1, 0)))
    size = np.hypot(gx, gy)
    border = int(3 * smooth)
    size[:border], size[-border:], size[:, :border], size[:, -border:] = 0, 0, 0, 0
    noise = background_of(values)[1]
    top = float(np.quantile(size, 0.998))
    # A derivative of a Gaussian of 2 px leaves 1 / (sqrt(8 pi) 2^2) of white noise.
    if top < 5.0 * max(noise, 0.1 * light.step) * 0.05:
        raise _no_edge(light)
    rows, columns = np.nonzero(size > 0.5 * top)
    random = np.random.default_rng(0)
    if len(rows) > 20_000:
        chosen = random.choice(len(rows), 20_000, replace=False)
        rows, columns = rows[chosen], columns[chosen]
    weight = size[rows, columns]
    points = np.stack([columns, rows], axis=1).astype(np.float64)
    directions = np.stack([gx[rows, columns], gy[rows, columns]], axis=1) / weight[:, None]
    best, score = (0.0, 0.0), -1.0
    for index in random.choice(len(rows), min(150, len(rows)), replace=False, p=weight / weight.sum()):
        normal = directions[index]
        along = directions @ normal > 0.97
        far = np.abs((points - points[index]) @ normal) < 4.0
        total = float(weight[along & far].sum())
        if total > score:
            best, score = (math.atan2(normal[1], normal[0]), float(points[index] @ normal)), total
    normal_angle, offset = best
    reach = 4.0
    for _ in range(8):
        n = np.array([math.cos(normal_angle), math.sin(normal_angle)])
        distance = points @ n - offset
        near = (np.abs(distance) < reach) & (directions @ n > 0.9)
        if near.sum() < 2 * SETTINGS.minimum_length:
            raise _no_edge(light)
        mean = np.average(points[near], axis=0, weights=weight[near])
        spread = np.cov(points[near].T, aweights=weight[near])
        axis = np.linalg.eigh(spread)[1][:, 0]
        axis = axis if axis @ n > 0 else -axis
        normal_angle, offset = math.atan2(axis[1], axis[0]), float(mean @ axis)
        across = math.sqrt(max(float(np.linalg.eigvalsh(spread)[0]), 0.25))
        reach = max(3.0, 3.0 * across)
    # px above half of the gradient's top form a band whose half width is 1.18 standard deviations.
    sigma = math.sqrt(max((across * math.sqrt(3.0) / 1.18) ** 2 - smooth**2, 0.3**2))
    return normal_angle, offset, sigma


def _band(light: Light, normal: float, offset: float, sigma: float) -> tuple[NDArray[np.bool_], tuple[float, float]]:
    """Which px belong to the edge: where along the line it really rises, and its surroundings on both sides."""
    height, width = light.values.shape
    y, x = np.mgrid[:height, :width]
    c, s = math.cos(normal), math.sin(normal)
    d = x * c + y * s - offset
    t = -x * s + y * c
    near = np.abs(d) < 5.0 * sigma + 4.0
    bins = np.floor(t[near] - t.min()).astype(int)
    value, distance = light.values[near], d[near]
    count = bins.max() + 1

    def mean(chosen: NDArray[np.bool_]) -> Array:
        number = np.bincount(bins[chosen], minlength=count)
        total = np.bincount(bins[chosen], value[chosen], minlength=count)
        return np.where(number > 0, total / np.maximum(number, 1), np.nan)

    outer = 2.0 * sigma + 0.5
    rise = mean(distance > outer) - mean(distance < -outer)
    good = np.nan_to_num(rise, nan=-1.0) > 0.7 * np.nanquantile(rise, 0.9) if np.isfinite(rise).any() else rise > 1e9
    labels, number = ndimage.label(ndimage.binary_closing(good, iterations=3))
    if number == 0:
        raise _no_edge(light)
    longest = int(np.argmax(np.bincount(labels.ravel())[1:])) + 1
    inside = np.flatnonzero(labels == longest)
    first, last = float(inside[0] + t.min()), float(inside[-1] + t.min())
    trim = min(2.0 * sigma, 0.1 * (last - first))
    mask = near & (t > first + trim) & (t < last - trim)
    if last - first - 2 * trim < SETTINGS.minimum_length or mask.sum() < 100:
        raise PsfError(
            f"The edge in '{light.name}' is only {max(0.0, last - first - 2 * trim):.0f} px long",
            f"Come nearer or crop less: at least {SETTINGS.minimum_length} px of straight edge are needed",
        )
    if min(-float(d[mask].min()), float(d[mask].max())) < SETTINGS.minimum_breadth * sigma:
        raise PsfError(
            f"The edge in '{light.name}' is cut off by the border, {sigma:.1f} px wide (sigma) as it is",
            f"Leave at least {math.ceil(5 * sigma)} px of black and of white on its sides",
        )
    middle = (first + last) / 2
    return mask, (offset * c - middle * s, offset * s + middle * c)


def _fit(
    values: Array, mask: NDArray[np.bool_], middle: tuple[float, float], normal: float, offset: float, sigma: float
) -> EdgeFit:
    """Step, its place, direction and width, and a gentle gradient of the light on either side."""
    rows, columns = np.nonzero(mask)
    if len(rows) > 60_000:
        chosen = np.random.default_rng(0).choice(len(rows), 60_000, replace=False)
        rows, columns = rows[chosen], columns[chosen]
    x, y, v = columns - middle[0], rows - middle[1], values[rows, columns]
    size = float(max(np.abs(x).max(), np.abs(y).max()))
    step = float(np.quantile(v, 0.95) - np.quantile(v, 0.05)) or 1.0
    low = float(np.quantile(v, 0.05))

    def model(p: Array) -> Array:
        d = x * math.cos(p[0]) + y * math.sin(p[0]) - p[1]
        shade = 1.0 + p[5] * x / size + p[6] * y / size
        return np.asarray((p[3] + p[4] * ndtr(d / p[2])) * shade)

    at = offset - middle[0] * math.cos(normal) - middle[1] * math.sin(normal)
    fit = least_squares(
        lambda p: (model(p) - v) / step,
        [normal, at, sigma, low, step, 0.0, 0.0],
        bounds=([-np.inf, -np.inf, 0.15, -np.inf, 0.0, -0.5, -0.5], [np.inf, np.inf, np.inf, np.inf, np.inf, 0.5, 0.5]),
        x_scale=[0.01, 0.1, sigma, step, step, 0.1, 0.1],
    )
    p = fit.x
    variance = 2 * fit.cost / max(1, len(v) - len(p))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * variance
    total = float(p[1] + middle[0] * math.cos(p[0]) + middle[1] * math.sin(p[0]))
    return EdgeFit(
        float(p[0]),
        total,
        float(p[2]),
        float(p[3]),
        float(p[3] + p[4]),
        math.sqrt(float(covariance[2, 2])),
        math.sqrt(variance) * step,
        middle,
        mask,
    )


def _check_slant(light: Light, edge: EdgeFit, d: Array) -> None:
    inner = d[edge.mask & (np.abs(d) < 2.0)]
    counts = np.histogram(inner, bins=int(4 * FINER), range=(-2.0, 2.0))[0]
    if counts.min() < 0.2 * counts.mean():
        raise PsfError(
            f"The edge in '{light.name}' is not slanted ({edge.slant:.1f} degrees off the pixel grid): its rows repeat"
            " the same few samples",
            "Turn the edge or the camera by about 5 degrees and photograph it again",
        )


def _mtf(values: Array, edge: EdgeFit, d: Array, structure: float) -> tuple[Array, Array]:
    """Frequencies (cycles/px) and contrast across the edge; where it drowns in noise the Gaussian goes on.

    `structure` in [0, 1] says how far the edge differs from a Gaussian's beyond noise.
    """
    reach = math.ceil(5.0 * edge.sigma + 3.0)
    bins = np.floor((d + reach) * FINER).astype(int)
    used = edge.mask & (bins >= 0) & (bins < 2 * reach * FINER)
    y, x = np.mgrid[: values.shape[0], : values.shape[1]]
    number = np.bincount(bins[used], minlength=2 * reach * FINER)
    total = np.bincount(bins[used], values[used], minlength=2 * reach * FINER)
    at = (np.arange(len(number)) + 0.5) / FINER - reach
    filled = number > 0
    profile = np.interp(at, at[filled], total[filled] / number[filled])
    line = np.gradient(profile, 1.0 / FINER) / (edge.high - edge.low)
    # Half a Hann window at either end: noise far from the edge is no part of the spread.
    far = np.clip((np.abs(at) - 0.7 * reach) / (0.3 * reach), 0.0, 1.0)
    line = line * np.cos(0.5 * np.pi * far) ** 2
    f = np.linspace(0.0, 2.0, 401)
    spectrum = np.abs(np.exp(-2j * np.pi * np.outer(f, at)) @ line) / FINER
    c, s = abs(math.cos(edge.normal)), abs(math.sin(edge.normal))
    # The pixel's square seen along the normal; the bins; the central difference of two bins' distance.
    window = np.sinc(f * c) * np.sinc(f * s) * np.sinc(f / FINER) * np.sinc(2 * f / FINER)
    found = spectrum / np.maximum(window, 0.05)
    found /= found[0]
    floor = float(np.median(spectrum[(f > 0.75) & (f < 1.75)]))
    sigma2 = max(edge.sigma**2 - PIXEL_VARIANCE, 1e-4)
    gaussian = np.exp(-2 * np.pi**2 * sigma2 * f**2)
    lost = np.flatnonzero((found < 4.0 * floor) | (f > 0.9))
    share = structure * np.clip((f[lost[0]] - f) / (0.3 * f[lost[0]] + 1e-9), 0.0, 1.0)
    return f, share * found + (1.0 - share) * gaussian


def _round_kernel(mtf: tuple[Array, Array], sigma: float) -> Array:
    """The round kernel whose contrast at every frequency is the measured one."""
    reach = math.ceil(6.0 * sigma) + 3
    size = 2 * reach + 1
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None, :])
    kernel = np.fft.fftshift(np.fft.ifft2(np.interp(frequency, *mtf)).real)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    # Ringing and noise beyond five standard deviations are no light.
    fade = np.clip((np.hypot(x, y) - 4.0 * sigma - 1.0) / (sigma + 1.0), 0.0, 1.0)
    return finished(kernel * np.cos(0.5 * np.pi * fade) ** 2)
