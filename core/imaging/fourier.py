"""Filters in the frequency domain: Wiener deconvolution and the Newton-type filter built from it.

With the blur's transfer function H and the noise-to-signal ratio n, the Wiener filter is
conj(H) / (|H|^2 + n), and the Newton-type filter |H|^2 / (|H|^2 + n) is what the Wiener filter makes
of a blurred view. Hence `newton(render) - wiener(photo) = wiener(blur(render) - photo)`, up to borders.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len
from torch import Tensor

from ..numbers import number
from .psf import PointSpread

Array = NDArray[np.float64]
Beyond = Literal["zero", "reflect"]


@dataclass(frozen=True)
class FilterSettings:
    """Numbers of filters in the frequency domain."""

    extension: float = number(
        1.5, "radii of the PSF", "that a frame is extended by before a transform; less lets its borders meet"
    )


FILTER = FilterSettings()


def _extension(psf: PointSpread) -> tuple[int, int]:
    rv, rh = psf.radius
    return math.ceil(FILTER.extension * rv), math.ceil(FILTER.extension * rh)


def _transfer(psf: PointSpread, size: tuple[int, int]) -> NDArray[np.complex128]:
    """[h, w // 2 + 1] transfer function of the PSF on a periodic grid of `size`."""
    kernel = psf.kernel()
    placed = np.zeros(size)
    rows = (np.arange(kernel.shape[0]) - kernel.shape[0] // 2) % size[0]
    columns = (np.arange(kernel.shape[1]) - kernel.shape[1] // 2) % size[1]
    np.add.at(placed, (rows[:, None], columns[None, :]), kernel)
    return np.fft.rfft2(placed)


def _noise(noise_to_signal: ArrayLike, size: tuple[int, int]) -> Array:
    """n on the half plane: a number, or values at equal steps of radial frequency 0 ... sqrt(1/2) cycles/px.

    Rows of values, one per channel, give one plane per channel.
    """
    values = np.asarray(noise_to_signal, dtype=np.float64)
    if values.ndim > 2 or not np.isfinite(values).all() or (values <= 0).any():
        raise ValueError("noise_to_signal is a positive number or a list of them over radial frequency")
    if values.ndim == 0:
        return np.asarray(values)
    radial = np.hypot(np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])[None, :])
    steps = np.linspace(0.0, math.sqrt(0.5), values.shape[-1])
    planes = np.stack([np.interp(radial, steps, row) for row in np.atleast_2d(values)])
    return planes if values.ndim == 2 else planes[0]


def fast_size(psf: PointSpread, height: int, width: int) -> tuple[int, int]:
    """Of a periodic grid on which a frame, zeros beyond it, does not meet itself through this blur."""
    rows, columns = _extension(psf)
    return next_fast_len(height + rows, real=True), next_fast_len(width + columns, real=True)


def transfer_on(
    size: tuple[int, int],
    psf: PointSpread,
    noise_to_signal: ArrayLike,
    kind: Literal["newton", "wiener"],
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.float32,
) -> Tensor:
    """[h, w // 2 + 1] transfer function of a filter on a periodic grid; real where the blur is symmetric."""
    h = _transfer(psf, size)
    power = np.abs(h) ** 2
    n = _noise(noise_to_signal, size)
    transfer = (power if kind == "newton" else h.conj()) / (power + n)
    real = np.abs(transfer.imag).max() < 1e-9 * np.abs(transfer).max()
    complex_type = torch.complex64 if dtype == torch.float32 else torch.complex128
    found = torch.from_numpy(transfer.real if real else transfer)
    return found.to(device=device, dtype=dtype if real else complex_type)


class FourierFilter:
    """A real filter of frames of one size, with its transfer function at hand.

    Args:
        psf: the blur; `noise_to_signal`: n > 0, or values at equal steps of radial frequency from 0
            to sqrt(1/2) cycles/px, in one row for all channels or one row each.
        shape: height and width of the frames in px.
        kind: 'newton' for |H|^2 / (|H|^2 + n), 'wiener' for conj(H) / (|H|^2 + n).
        beyond: what lies beyond the frame: 'zero' fits residuals and makes `adjoint` the exact
            transpose; 'reflect' fits pictures.
    """

    def __init__(
        self,
        psf: PointSpread,
        shape: tuple[int, int],
        noise_to_signal: ArrayLike,
        kind: Literal["newton", "wiener"] = "newton",
        beyond: Beyond = "zero",
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        (height, width), self.beyond = shape, beyond
        self.height, self.width = shape
        extension = _extension(psf)
        if beyond == "reflect":
            self.before = min(extension[0], height - 1), min(extension[1], width - 1)
            extent = height + 2 * self.before[0], width + 2 * self.before[1]
        else:  # zeros wrap around: one extension serves both sides
            self.before = 0, 0
            extent = height + extension[0], width + extension[1]
        self.size = next_fast_len(extent[0], real=True), next_fast_len(extent[1], real=True)
        self.transfer = transfer_on(self.size, psf, noise_to_signal, kind, device, dtype)
        self._window = _taper(self.size, self.before, height, width).to(device=device, dtype=dtype)

    def apply(self, frame: Tensor) -> Tensor:
        """[C, H, W] -> [C, H, W]; without gradient."""
        return self._filtered(frame.detach(), self.transfer)

    def adjoint(self, frame: Tensor) -> Tensor:
        """The transpose of `apply` where zeros lie beyond the frame."""
        if self.beyond != "zero":
            raise ValueError("only a filter with zeros beyond the frame has its adjoint here")
        return self._filtered(frame.detach(), self.transfer.conj())

    def _filtered(self, frame: Tensor, transfer: Tensor) -> Tensor:
        top, left = self.before
        if self.beyond == "reflect":
            frame = self._reflected(frame)
        spectrum = torch.fft.rfft2(frame, s=self.size).mul_(transfer)
        out = torch.fft.irfft2(spectrum, s=self.size)
        return out[:, top : top + self.height, left : left + self.width].contiguous()

    def _reflected(self, frame: Tensor) -> Tensor:
        """Reflected beyond the frame, and blended towards the mean where the grid wraps around."""
        (top, left), (rows, columns) = self.before, self.size
        padding = (left, columns - self.width - left, top, rows - self.height - top)
        mean = frame.mean(dim=(1, 2), keepdim=True)
        limits = (self.width - 1, self.width - 1, self.height - 1, self.height - 1)
        first = tuple(min(p, limit) for p, limit in zip(padding, limits, strict=True))
        rest = tuple(p - f for p, f in zip(padding, first, strict=True))
        grown = torch.nn.functional.pad(frame[None] - mean[None], first, mode="reflect")[0]
        return torch.nn.functional.pad(grown, rest) * self._window + mean


def _taper(size: tuple[int, int], before: tuple[int, int], height: int, width: int) -> Tensor:
    """[h, w]: 1 on the frame, falling as a squared cosine to 0 half-way around the periodic grid."""

    def axis(total: int, first: int, inside: int) -> Tensor:
        position = torch.arange(total, dtype=torch.float64)
        past = torch.minimum((position - (first + inside - 1)) % total, (first - position) % total)
        past[first : first + inside] = 0
        return torch.cos(0.5 * math.pi * past / max(1.0, (total - inside) / 2)).clamp(min=0) ** 2

    return axis(size[0], before[0], height)[:, None] * axis(size[1], before[1], width)[None, :]


def wiener_photo(planes: Tensor, psf: PointSpread | None, noise_to_signal: ArrayLike) -> Tensor:
    """Wiener deconvolution of one photo.

    Args:
        planes: [C, H, W] in the space that the blur happened in. Beyond the frame the photo is
            reflected, and tapered to its mean where the periodic grid closes.
        psf: the blur; None or sigma 0 returns the photo as it is.
        noise_to_signal: n > 0 (1e-5 for 8-bit photos of many views), or values at equal steps of
            radial frequency from 0 to sqrt(1/2) cycles/px.

    Returns:
        [C, H, W] of the photo's dtype, not clipped. Nearer to the border than the PSF reaches it cannot be trusted:
        what the photo does not show lit it.
    """
    height, width = planes.shape[1:]
    if psf is None or psf.is_identity:
        return planes
    wiener = FourierFilter(
        psf, (height, width), noise_to_signal, "wiener", "reflect", device=planes.device, dtype=planes.dtype
    )
    return wiener.apply(planes)
