"""Point spread functions: what the medium does to a point of light, in pixels of the photo.

A point spread is non-negative, sums to 1 and is centred: its centroid is the middle of the middle
pixel. Whatever had to be put right when it was read is said in `PointSpread.notes`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import PsfError
from ..numbers import number
from .kernel_samples import convolved_samples, interpolation, moments, trimmed


@dataclass(frozen=True)
class PointSpreadSettings:
    """Numbers of point spreads as arrays."""

    truncation: float = number(
        4.0,
        "standard deviations",
        "that a Gaussian is cut at (6e-5 of its light lies beyond) and renormalised; a wider one takes longer",
    )
    thinnest_tilted: float = number(
        0.3, "px", "standard deviation below which a Gaussian that is tilted against the px' grid slips between px"
    )
    longest_side: int = number(
        1025, "px", "of a kernel file; a larger one is refused: it is a picture rather than a point spread"
    )
    sum_tolerance: float = number(1e-3, "share", "that the sum of a kernel file may be off 1 and count as normalised")


POINT_SPREAD = PointSpreadSettings()

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointSpread:
    """One point spread function (PSF).

    Attributes:
        kind: 'gaussian', or 'file' for sampled values.
        sigma_x, sigma_y: standard deviations (px) along the Gaussian's own axes.
        angle: degrees from the photo's x axis to the Gaussian's, clockwise as seen (y is down).
        samples: [K, L] float64, odd sizes, of a kernel from a file; None for a Gaussian.
        source: what the user asked for, as the report prints it.
        notes: what was put right when the kernel was read, one sentence each.
    """

    kind: Literal["gaussian", "file"] = "gaussian"
    sigma_x: float = 0.0
    sigma_y: float = 0.0
    angle: float = 0.0
    samples: Array | None = None
    source: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def is_identity(self) -> bool:
        """Whether the PSF leaves every photo as it is, to the bit."""
        if self.samples is not None:
            return self.samples.size == 1
        return self.sigma_x == 0.0 and self.sigma_y == 0.0

    @property
    def radius(self) -> tuple[int, int]:
        """Pixels (vertical, horizontal) that the PSF reaches to either side."""
        rows, columns = self.kernel().shape
        return rows // 2, columns // 2

    @property
    def covariance(self) -> Array:
        """[2, 2] covariance (px^2) in x, y order."""
        if self.samples is not None:
            return moments(self.samples)[1]
        c, s = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        axes = np.array([[c, -s], [s, c]])
        return axes @ np.diag([self.sigma_x**2, self.sigma_y**2]) @ axes.T

    def kernel(self, scale: float = 1.0) -> Array:
        """The PSF's samples on a grid whose pixels are `scale` times wider, and nothing more.

        Args:
            scale: >= 1; the variance in the grid's own px^2 is this PSF's divided by scale^2.

        Returns:
            [K, L] float64 of odd sizes with sum 1; row 0 is the top. The photo is
            `out[p] = sum_k kernel[k + radius] * scene[p - k]` (a convolution).
        """
        if scale != 1.0:
            return self._scaled(scale).kernel()
        if self.samples is not None:
            return self.samples
        separable = self.separable()
        if separable is not None:
            return np.outer(*separable)
        covariance = self._tilted_covariance()
        rx, ry = (math.ceil(POINT_SPREAD.truncation * math.sqrt(v)) for v in np.diag(covariance))
        y, x = np.mgrid[-ry : ry + 1, -rx : rx + 1]
        a, b, c = np.linalg.inv(covariance)[[0, 0, 1], [0, 1, 1]]
        values = np.exp(-0.5 * (a * x * x + 2 * b * x * y + c * y * y))
        return np.asarray(values / values.sum())

    def separable(self) -> tuple[Array, Array] | None:
        """(vertical, horizontal) taps [2r + 1] float64 whose outer product is the kernel, or None."""
        if self.samples is None:
            turn = self.angle % 180.0
            if self.sigma_x == self.sigma_y or turn == 0.0:
                return gaussian_taps(self.sigma_y), gaussian_taps(self.sigma_x)
            return (gaussian_taps(self.sigma_x), gaussian_taps(self.sigma_y)) if turn == 90.0 else None
        vertical, horizontal = self.samples.sum(axis=1), self.samples.sum(axis=0)
        rank_one = np.abs(np.outer(vertical, horizontal) - self.samples).max() <= 1e-7 * self.samples.max()
        return (vertical, horizontal) if rank_one else None

    def on_grid(self, s: float, low_pass: float = 0.0) -> PointSpread:
        """The PSF for photos area-averaged by `s` while the view is rendered on the coarse grid itself.

        A coarse pixel averages s x s fine ones, whose centres have variance (s^2 - 1)/12 along each
        axis, so the PSF's variance becomes (sigma^2 + (s^2 - 1)/12) / s^2 in coarse px^2. The render
        takes point samples after the rasterizer's low-pass of `l` px^2 of its own grid. With
        `low_pass=0` that low-pass counts as part of the twin. With `low_pass=l` the twin is to look
        right on the fine grid too, and the l (s^2 - 1) that the coarse render adds beyond the fine
        one is taken from the PSF, as far as there is any.
        """
        if s < 1.0:
            raise ValueError(f"a coarser grid has s >= 1, not {s}")
        if s == 1.0:
            return self
        added = (s * s - 1.0) * (1.0 / 12.0 - low_pass)
        if self.samples is None:
            sx, sy = (math.sqrt(max(v * v + added, 0.0)) / s for v in (self.sigma_x, self.sigma_y))
            return replace(self, sigma_x=sx, sigma_y=sy)
        # Three taps have any small variance v: (v/2, 1 - v, v/2); negative v sharpens.
        v = max(added / (s * s), -0.2)
        taps = np.array([v / 2, 1.0 - v, v / 2])
        return replace(self, samples=convolved_samples(self._scaled(s).kernel(), np.outer(taps, taps)))

    def mtf(self, frequencies: ArrayLike, angle: float = 0.0) -> Array:
        """Contrast that passes at `frequencies` (cycles/px) along `angle` (degrees from x towards y)."""
        f = np.asarray(frequencies, dtype=np.float64)
        fx, fy = f * math.cos(math.radians(angle)), f * math.sin(math.radians(angle))
        if self.samples is None:
            (a, b), (_, c) = self.covariance
            return np.asarray(np.exp(-2 * np.pi**2 * (a * fx * fx + 2 * b * fx * fy + c * fy * fy)))
        rows, columns = self.samples.shape
        y, x = np.arange(rows) - rows // 2, np.arange(columns) - columns // 2
        across, down = (np.exp(-2j * np.pi * np.multiply.outer(g, t)) for g, t in ((fx, x), (fy, y)))
        return np.asarray(np.abs(((down @ self.samples) * across).sum(axis=-1)))

    def resolvable_period(self, noise: float) -> float:
        """Shortest period (px) of a pattern of contrast 1 that stays above `noise` in every direction.

        Args:
            noise: standard deviation of the photo's noise over the pattern's amplitude, in (0, 1).

        Returns:
            At least 2 px, which is what the pixel grid itself allows.
        """
        frequencies = np.linspace(0.0, 0.5, 513)
        worst = np.min([self.mtf(frequencies, a) for a in np.arange(0.0, 180.0, 22.5)], axis=0)
        lost = np.flatnonzero(worst < noise)
        return 2.0 if lost.size == 0 else float(1.0 / frequencies[max(1, lost[0] - 1)])

    def _tilted_covariance(self) -> Array:
        thick = replace(
            self,
            sigma_x=max(self.sigma_x, POINT_SPREAD.thinnest_tilted),
            sigma_y=max(self.sigma_y, POINT_SPREAD.thinnest_tilted),
        )
        return thick.covariance

    def _scaled(self, s: float) -> PointSpread:
        if self.samples is None:
            return replace(self, sigma_x=self.sigma_x / s, sigma_y=self.sigma_y / s)
        rows, columns = self.samples.shape
        vertical, horizontal = interpolation(rows, s), interpolation(columns, s)
        values = vertical @ self.samples @ horizontal.T
        return replace(self, samples=values / values.sum())


def gaussian_taps(sigma: float, truncation: float = POINT_SPREAD.truncation) -> Array:
    """[2 r + 1] float64 samples of a Gaussian, cut at r >= truncation * sigma, with sum 1; [1] for sigma 0."""
    radius = math.ceil(truncation * sigma)
    if radius == 0:
        return np.ones(1)
    # Divided before squaring, as a square underflows for tiny sigmas; 40 sigma are as far as infinity.
    with np.errstate(over="ignore"):
        values = np.exp(-0.5 * np.clip(np.arange(-radius, radius + 1) / sigma, -40, 40) ** 2)
    return np.asarray(values / values.sum())


def point_spread_from_samples(values: ArrayLike, source: str = "samples") -> PointSpread:
    """Checks sampled values, then normalises, centres and trims them.

    Args:
        values: [K, L] linear values; row 0 is the top.
        source: what they came from, for messages.

    Raises:
        PsfError: negative, not finite, dark, too large, or centred far off the middle.
    """
    samples = np.array(values, dtype=np.float64)
    notes: list[str] = []
    if samples.ndim != 2 or samples.size == 0:
        raise PsfError(f"The PSF '{source}' has shape {samples.shape}", "Give a single-channel picture")
    if max(samples.shape) > POINT_SPREAD.longest_side:
        raise PsfError(
            f"The PSF '{source}' is {samples.shape[1]} x {samples.shape[0]} px",
            f"Crop it to {POINT_SPREAD.longest_side} px or less",
        )
    if not np.isfinite(samples).all():
        raise PsfError(f"The PSF '{source}' holds values that are not finite", "Replace them by 0")
    if samples.min() < -1e-6 * abs(samples).max():
        raise PsfError(f"The PSF '{source}' holds negative values", "Subtract the background and cut at 0")
    samples = samples.clip(min=0.0)
    total = samples.sum()
    if total <= 0:
        raise PsfError(f"The PSF '{source}' is dark", "Give a picture of a point of light")
    if abs(total - 1.0) > POINT_SPREAD.sum_tolerance:
        notes.append(f"its sum was {total:.6g} and is now 1")
    samples /= total
    samples, centring = _centred(samples, source)
    return PointSpread("file", samples=trimmed(samples), source=source, notes=(*notes, *centring))


def _centred(samples: Array, source: str) -> tuple[Array, list[str]]:
    """Moves the centroid onto the middle of the middle pixel of odd-sized samples."""
    notes: list[str] = []
    even = [n for n in samples.shape if n % 2 == 0]
    centroid = moments(samples)[0]
    for offset, size in zip(centroid, samples.shape[::-1], strict=True):
        if abs(offset) > max(1.0, size / 4):
            raise PsfError(
                f"The PSF '{source}' has its centroid {abs(offset):.1f} px off the middle of its {size} px",
                "Crop it around the point of light, and subtract the background",
            )
    if not even and np.abs(centroid).max() < 1e-3:
        return samples, notes
    if even:
        notes.append(f"its even size {samples.shape[1]} x {samples.shape[0]} was made odd")
    # From the middle pixel of an odd grid; an even size has its middle between two pixels.
    notes.append(f"it was moved by ({-centroid[0]:+.3f}, {-centroid[1]:+.3f}) px onto the pixel grid's middle")
    for linear in (False, True):
        moved = samples
        for _ in range(8):  # cutting the cubic's undershoot at 0 moves the centroid a little again
            offset_x, offset_y = moments(moved)[0]
            if max(abs(offset_x), abs(offset_y)) < 1e-9 and all(n % 2 for n in moved.shape):
                break
            rows = interpolation(moved.shape[0], 1.0, offset_y, linear)
            columns = interpolation(moved.shape[1], 1.0, offset_x, linear)
            moved = rows @ moved @ columns.T
            undershoot = -moved.min() / moved.max()
            if undershoot > 1e-2:
                break
            moved = moved.clip(min=0.0)
            moved /= moved.sum()
        else:
            undershoot = 0.0
        if not linear and moved.min() >= 0:
            break
    return moved, notes
