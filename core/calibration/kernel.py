"""From noisy samples around a source to a kernel that the engine takes: centred, non-negative, sum 1."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from .light import PIXEL_VARIANCE, Array

#: Standard deviation (px) of the thinnest spread that samples one px apart can hold.
THINNEST = 0.3
#: Frequencies at which a measured kernel's contrast is reported, cycles/px.
FREQUENCIES = np.linspace(0.0, 0.5, 101)


def centred_kernel(
    values: Array, centre: tuple[float, float], amplitude: float, covariance: Array, noise: float
) -> Array:
    """[K, K] float64: the point spread out of a window around a source, background removed.

    Where single pixels stand clear of the noise they are kept as they are; where they do not, the mean over the
    ellipse around the centre takes over, and nothing is kept beyond the radius where that too drowns. To centre it,
    the fitted Gaussian is sampled anew, without the pixel's footprint; only what it leaves over is interpolated.

    Args:
        values: [2r + 1, 2r + 1] background at 0.
        centre: (x, y) of the source from the window's middle pixel, px.
        amplitude, covariance: of the fitted Gaussian; [2, 2] px^2, in x, y order.
        noise: standard deviation of a pixel.
    """
    reach = values.shape[0] // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    sigma = math.sqrt(math.sqrt(float(np.linalg.det(covariance))))
    away = elliptic(x - centre[0], y - centre[1], covariance)
    radius = sigma * away
    means, errors = _profile(values, radius, noise)
    lost = np.flatnonzero(means < 2.0 * errors)
    end = float(lost[0]) if lost.size else float(len(means) - 1)
    end = max(end, 2.0 * sigma)
    smooth = np.interp(radius, np.arange(len(means)), np.maximum(means, 0.0))
    smooth = _bell(means, radius, end, sigma, smooth)
    share = smooth**2 / (smooth**2 + (3.0 * noise) ** 2) if noise > 0 else np.ones_like(smooth)
    cleaned = share * values + (1.0 - share) * smooth
    cleaned = np.where(radius < end, cleaned, smooth)
    rest = values - amplitude * np.exp(-0.5 * away**2)
    core = rest[away < 4.0]
    trusted = believed(float(np.mean(core**2)), noise**2, core.size)
    rest = trusted * _moved(cleaned - amplitude * np.exp(-0.5 * away**2), -centre[0], -centre[1])
    medium = covariance - PIXEL_VARIANCE * np.eye(2)
    widths, axes = np.linalg.eigh(medium)
    medium = axes @ np.diag(np.maximum(widths, THINNEST**2)) @ axes.T
    brighter = amplitude * math.sqrt(float(np.linalg.det(covariance) / np.linalg.det(medium)))
    return finished(brighter * np.exp(-0.5 * elliptic(x, y, medium) ** 2) + _without_pixel(rest))


def believed(variance: float, noise: float, count: int) -> float:
    """How far what a Gaussian fit leaves over is structure, in [0, 1] (James and Stein's shrinkage).

    Args:
        variance: mean square of what is left over; noise: what noise alone would leave.
        count: how many values were averaged: chance alone gives a ratio of 1 +- sqrt(2 / count).
    """
    ratio = variance / max(noise, 1e-30)
    return float(np.clip((ratio - 1.0 - 2.0 * math.sqrt(2.0 / max(count, 1))) / ratio, 0.0, 1.0)) if ratio > 0 else 0.0


def elliptic(x: Array, y: Array, covariance: Array) -> Array:
    """How many standard deviations (x, y) lies from the middle of a Gaussian."""
    a, b, c = np.linalg.inv(covariance)[[0, 0, 1], [0, 1, 1]]
    return np.asarray(np.sqrt(a * x * x + 2 * b * x * y + c * y * y))


def finished(values: Array) -> Array:
    """Non-negative, sum 1, its centroid in the middle, cropped to what holds all but 1e-4 of the light."""
    kernel = np.maximum(values, 0.0)
    kernel /= kernel.sum()
    for _ in range(4):
        reach = kernel.shape[0] // 2
        t = np.arange(-reach, reach + 1)
        x, y = float(kernel.sum(axis=0) @ t), float(kernel.sum(axis=1) @ t)
        if math.hypot(x, y) < 1e-4:
            break
        kernel = np.maximum(_moved(kernel, -x, -y), 0.0)
        kernel /= kernel.sum()
    middle = kernel.shape[0] // 2
    for reach in range(1, middle + 1):
        inner = kernel[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
        if inner.sum() > 1.0 - 1e-4:
            return np.asarray(inner / inner.sum())
    return kernel


def radial_mtf(kernel: Array) -> tuple[Array, Array]:
    """Frequencies [n] (cycles/px) and the kernel's contrast there, mean over directions."""
    reach = kernel.shape[0] // 2
    t = np.arange(-reach, reach + 1)
    found = []
    for angle in np.radians(np.arange(0.0, 180.0, 15.0)):
        rows = np.exp(-2j * np.pi * np.outer(FREQUENCIES * math.sin(angle), t))
        columns = np.exp(-2j * np.pi * np.outer(FREQUENCIES * math.cos(angle), t))
        found.append(np.abs(np.einsum("fi,ij,fj->f", rows, kernel, columns)))
    return FREQUENCIES, np.mean(found, axis=0)


def fwhm_of(kernel: Array) -> float:
    """Full width at half maximum, px: mean over directions through the peak, on a finer grid."""
    finer = 8
    fine = ndimage.zoom(kernel, finer, order=3, mode="grid-constant", grid_mode=True)
    inside = fine > 0.5 * fine.max()
    labels, _ = ndimage.label(inside)
    peak = labels == labels.flat[int(np.argmax(fine))]
    return 2.0 * math.sqrt(float(peak.sum()) / math.pi) / finer


def _profile(values: Array, radius: Array, noise: float) -> tuple[Array, Array]:
    """Mean over rings one px wide around the centre, and its standard error."""
    bins = np.rint(radius).astype(int)
    most = values.shape[0] // 2
    inside = bins <= most
    counts = np.maximum(np.bincount(bins[inside], minlength=most + 1), 1)
    means = np.bincount(bins[inside], values[inside], minlength=most + 1) / counts
    return means, np.maximum(noise, 1e-12) / np.sqrt(counts)


def _bell(means: Array, radius: Array, end: float, sigma: float, smooth: Array) -> Array:
    """The rings' profile up to `end`; from there the Gaussian that joins it, so that light does not end in a step."""
    level = float(np.interp(end, np.arange(len(means)), np.maximum(means, 0.0)))
    tail = level * np.exp(-0.5 * (radius**2 - end**2) / sigma**2)
    return np.where(radius < end, smooth, np.minimum(tail, level))


def _without_pixel(kernel: Array) -> Array:
    """Takes the pixel's own footprint out: three taps of variance -1/12 along each axis."""
    v = PIXEL_VARIANCE
    taps = np.array([-v / 2, 1.0 + v, -v / 2])
    across = ndimage.convolve1d(kernel, taps, 0, mode="constant")
    return np.asarray(ndimage.convolve1d(across, taps, 1, mode="constant"))


def _moved(kernel: Array, x: float, y: float) -> Array:
    """Moved by a fraction of a pixel (quintic spline: next to nothing is lost below 0.4 cycles/px)."""
    return np.asarray(ndimage.shift(kernel, (y, x), order=5, mode="constant"))
