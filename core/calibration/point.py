"""The point spread from a photo of a point of light (pinhole, star, bead) through the medium.

The photo of a point IS the point spread, moved by a fraction of a pixel, on a background, with noise, and widened
by the pixel's own footprint. Each of the four is taken off: in that order the centre, a plane, what does not stand
clear of the noise, and 1/12 px^2 of variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.optimize import least_squares

from ..errors import PsfError
from ..numbers import number
from .kernel import centred_kernel, elliptic, fwhm_of, radial_mtf
from .light import PIXEL_VARIANCE, Array, Light
from .measured import MeasuredPsf


@dataclass(frozen=True)
class PointPhotoSettings:
    """What a photo of a point of light must show."""

    minimum_height: float = number(
        12.0, "standard deviations of the smoothed noise", "that a source must stand above the background"
    )
    hot_pixels: int = number(1, "count", "saturated px inside the source that are still taken for hot pixels")
    largest_window: float = number(12.0, "standard deviations", "to each side of the source that are read at most")
    smallest_window: float = number(3.5, "standard deviations", "to each side of the source that a fit needs")
    narrow: float = number(0.6, "px", "a narrower blur (sigma) is reported as an upper bound: pixels hide it")
    not_gaussian: float = number(
        0.02, "share of the peak", "misfit above which the user is advised to use the kernel file"
    )
    elongated: float = number(1.1, "ratio", "of both widths, above which the user is shown them")


SETTINGS = PointPhotoSettings()


def background_of(values: Array) -> tuple[float, float]:
    """Level and standard deviation of the noise of most of a picture, whatever small thing shines in it."""
    level = float(np.median(values))
    # Differences of neighbours keep the noise and lose gradients; 1.4826 MAD is a normal standard deviation.
    across = np.diff(values, axis=1) / math.sqrt(2.0)
    noise = 1.4826 * float(np.median(np.abs(across - np.median(across))))
    return level, noise


def measure_point(light: Light) -> MeasuredPsf:
    """The point spread of the brightest point in the photo.

    Raises:
        PsfError: no source, saturated, or too near to the border.
    """
    level, noise = background_of(light.values)
    noise = max(noise, 0.3 * light.step * (0.1 if light.linear else 1.0))
    row, column, width = _find(light, level, noise)
    height, breadth = light.values.shape
    free = min(column + 0.5, row + 0.5, breadth - column - 0.5, height - row - 0.5)
    needed = SETTINGS.smallest_window * width
    if free < needed:
        raise PsfError(
            f"The source in '{light.name}' lies {free:.0f} px from the border and is about {width:.1f} px wide (sigma)",
            f"Move it towards the middle: at least {math.ceil(needed)} px of surroundings are needed",
        )
    reach = int(min(free - 0.5, max(6.0, math.ceil(SETTINGS.largest_window * width))))
    r, c = round(row), round(column)
    window = light.values[r - reach : r + reach + 1, c - reach : c + reach + 1]
    near = light.saturated[r - reach : r + reach + 1, c - reach : c + reach + 1]
    bright = window > level + 0.5 * (window.max() - level)
    if int((near & bright).sum()) > SETTINGS.hot_pixels:
        raise PsfError(
            f"The source in '{light.name}' is saturated ({int((near & bright).sum())} px): its top is cut off",
            "Expose shorter, so that the brightest pixel stays below about 90 % of the range",
        )
    fitted = _fit(window, width)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    distance = elliptic(x - fitted.x, y - fitted.y, fitted.covariance)
    clean = window - _plane(window, x, y, distance, fitted)
    spread = float(np.std(clean[distance > 4.5])) if (distance > 4.5).sum() > 20 else noise
    kernel = centred_kernel(clean, (fitted.x, fitted.y), fitted.amplitude, fitted.covariance, spread)
    medium = fitted.covariance - PIXEL_VARIANCE * np.eye(2)
    values, vectors = np.linalg.eigh(medium)
    values = np.maximum(values, 1e-4)
    frequencies, mtf = radial_mtf(kernel)
    sigmas = np.sqrt(values)
    # d sigma = d variance / (2 sigma): the pixel's share, taken off, makes a narrow spread less certain.
    inflated = math.sqrt(float(np.linalg.det(fitted.covariance))) / float(sigmas[0] * sigmas[1])
    residual = fitted.residual**2 - spread**2
    notes = _notes(light, sigmas, residual, fitted.amplitude)
    return MeasuredPsf(
        "point",
        light.space,
        kernel,
        float(sigmas[1]),
        float(sigmas[0]),
        math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0,
        fitted.uncertainty * math.sqrt(inflated),
        fwhm_of(kernel),
        math.sqrt(max(residual, 0.0)) / fitted.amplitude,
        frequencies,
        mtf,
        (c + 0.5 + fitted.x, r + 0.5 + fitted.y),
        None,
        notes,
    )


def _notes(light: Light, sigmas: Array, residual: float, amplitude: float) -> tuple[str, ...]:
    notes = []
    if sigmas[1] > SETTINGS.elongated * sigmas[0]:
        notes.append(f"wider along one direction: {sigmas[1]:.2f} against {sigmas[0]:.2f} px")
    if residual > 0 and math.sqrt(residual) > SETTINGS.not_gaussian * amplitude:
        notes.append("not a Gaussian: use the kernel file rather than gaussian:SIGMA")
    if sigmas[0] < SETTINGS.narrow:
        notes.append("narrower than the pixels can tell: the width is an upper bound")
    return tuple(notes)


def _find(light: Light, level: float, noise: float) -> tuple[float, float, float]:
    """(row, column, standard deviation) of the brightest source, px; row and column of a pixel's index."""
    smooth = ndimage.gaussian_filter(light.values, 1.5)
    row, column = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    peak = float(smooth[row, column]) - level
    # A Gaussian filter of 1.5 px leaves 1 / (2 sqrt(pi) 1.5) of white noise.
    if peak < SETTINGS.minimum_height * noise * 0.188 or peak <= 2 * light.step * (0.1 if light.linear else 1.0):
        raise PsfError(
            f"No point of light stands out of the background in '{light.name}'",
            "Darken the room, expose longer, or use --kind edge for a photo of a slanted edge",
        )
    labels, _ = ndimage.label(smooth > level + 0.5 * peak)
    inside = labels == labels[row, column]
    sigma = math.sqrt(max(float(inside.sum()) / (2 * math.pi * math.log(2.0)) - 1.5**2, 0.25))
    rows, columns = np.nonzero(inside)
    weight = smooth[inside] - level
    return float(np.average(rows, weights=weight)), float(np.average(columns, weights=weight)), sigma


@dataclass(frozen=True)
class _Fitted:
    """A Gaussian on a plane, from the window's middle pixel; `uncertainty` is that of its width, px."""

    amplitude: float
    x: float
    y: float
    covariance: Array
    uncertainty: float
    residual: float


def _covariance(p: Array) -> Array:
    root = np.array([[p[3], 0.0], [p[4], p[5]]])  # Cholesky: always a covariance
    return root @ root.T


def _fit(window: Array, width: float) -> _Fitted:
    """Least squares of a Gaussian on a plane; its uncertainty is what noise and misfit leave."""
    reach = window.shape[0] // 2
    fit_reach = int(min(reach, max(6, math.ceil(5 * width))))
    cut = slice(reach - fit_reach, reach + fit_reach + 1)
    values = window[cut, cut]
    y, x = np.mgrid[-fit_reach : fit_reach + 1, -fit_reach : fit_reach + 1].astype(np.float64)
    level = float(np.median(np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])))
    amplitude = float(values.max()) - level

    def model(p: Array) -> Array:
        d = elliptic(x - p[1], y - p[2], _covariance(p))
        return np.asarray(p[0] * np.exp(-0.5 * d * d) + p[6] + p[7] * x + p[8] * y)

    start = np.array([amplitude, 0.0, 0.0, width, 0.0, width, level, 0.0, 0.0])
    size = np.array([amplitude, width, width, width, width, width, amplitude, amplitude / 9, amplitude / 9])
    fit = least_squares(lambda p: ((model(p) - values) / amplitude).ravel(), start, x_scale=size)
    p = np.asarray(fit.x)
    freedom = max(1, values.size - len(p))
    variance = 2 * fit.cost / freedom
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac) * variance
    # sigma = sqrt(l11 l22): d sigma / sigma = (d l11 / l11 + d l22 / l22) / 2
    gradient = np.zeros(len(p))
    sigma = math.sqrt(abs(p[3] * p[5]))
    gradient[3], gradient[5] = sigma / (2 * p[3]), sigma / (2 * p[5])
    uncertainty = math.sqrt(max(float(gradient @ inverse @ gradient), 0.0))
    residual = math.sqrt(2 * fit.cost / freedom) * amplitude
    return _Fitted(float(p[0]), float(p[1]), float(p[2]), _covariance(p), uncertainty, residual)


def _plane(window: Array, x: Array, y: Array, distance: Array, fitted: _Fitted) -> Array:
    """[K, K] the background under the source, from the pixels around it, outliers left out."""
    far = distance > max(4.5, 0.6 * float(distance.max()) if distance.max() > 9 else 4.5)
    if far.sum() < 30:
        far = distance > 0.75 * float(distance.max())
    matrix = np.stack([np.ones_like(x), x, y], axis=-1)
    keep = far.copy()
    solution = np.zeros(3)
    for _ in range(4):
        solution = np.linalg.lstsq(matrix[keep], window[keep], rcond=None)[0]
        rest = window - matrix @ solution
        spread = 1.4826 * float(np.median(np.abs(rest[far])))
        keep = far & (np.abs(rest) < 3.0 * max(spread, 1e-12))
        if keep.sum() < 12:
            break
    return np.asarray(matrix @ solution)
