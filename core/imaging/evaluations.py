"""Ways to evaluate one blur on any device: by Fourier transforms, and at reduced resolution; and which ones fit it.

Each maps a frame with a margin [C, H + 2m, W + 2m] to the photo's [C, H, W] (`apply`) and back
(`adjoint`, the exact transpose). Beyond the margin the frame's edge is repeated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from torch import Tensor

from ..devices import backend_on
from ..frames import Evaluation, Frame
from ..numbers import BY_DEFINITION, number
from .psf import PointSpread, gaussian_taps

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReducedSettings:
    """Numbers of the blur at reduced resolution."""

    tolerance: float = number(
        1e-4,
        "share of the frame's range",
        "that it may differ by from the blur itself, by its bound: a fortieth of an 8-bit step",
        BY_DEFINITION,
    )
    smallest_sigma: float = number(
        2.0, "px", "standard deviation from which on it is offered; a narrower blur leaves no px to be saved"
    )
    step: float = number(
        0.65,
        "standard deviations",
        "of the coarse grid: folding is worst half-way to the replica, exp(-(pi sigma / step)^2 / 2) = 8e-6",
        BY_DEFINITION,
    )
    reach: float = number(
        5.0, "standard deviations", "that both Gaussians are cut at; the cut adds the rest of the bound"
    )
    reference_reach: float = number(
        6.0, "standard deviations", "that the blur is cut at which the bound compares with", BY_DEFINITION
    )


REDUCED = ReducedSettings()


def extended(frame: Tensor, vertical: int, horizontal: int) -> Tensor:
    """[C, h, w] -> [C, h + 2 vertical, w + 2 horizontal]: repeats the edge, or crops where negative."""
    grown = (max(horizontal, 0),) * 2 + (max(vertical, 0),) * 2
    if any(grown):
        frame = torch.nn.functional.pad(frame[None], grown, mode="replicate")[0]
    top, left = max(-vertical, 0), max(-horizontal, 0)
    return frame[:, top : frame.shape[1] - top, left : frame.shape[2] - left]


def folded(gradient: Tensor, vertical: int, horizontal: int) -> Tensor:
    """The transpose of `extended`."""
    top, left = max(-vertical, 0), max(-horizontal, 0)
    gradient = torch.nn.functional.pad(gradient, (left, left, top, top))
    if vertical > 0:
        inner = gradient[:, vertical:-vertical].clone()
        inner[:, 0] += gradient[:, :vertical].sum(dim=1)
        inner[:, -1] += gradient[:, -vertical:].sum(dim=1)
        gradient = inner
    if horizontal > 0:
        inner = gradient[:, :, horizontal:-horizontal].clone()
        inner[:, :, 0] += gradient[:, :, :horizontal].sum(dim=2)
        inner[:, :, -1] += gradient[:, :, -horizontal:].sum(dim=2)
        gradient = inner
    return gradient


class Fourier:
    """Multiplication by the transfer function; the frame is extended so that nothing wraps around."""

    name = "fourier"

    def __init__(self, kernel: Array, frame: Frame, dtype: torch.dtype, device: torch.device) -> None:
        self.frame = frame
        self.radius = kernel.shape[0] // 2, kernel.shape[1] // 2
        extent = frame.height + 2 * self.radius[0], frame.width + 2 * self.radius[1]
        self.size = next_fast_len(extent[0], real=True), next_fast_len(extent[1], real=True)
        placed = np.zeros(self.size)
        placed[: kernel.shape[0], : kernel.shape[1]] = kernel
        placed = np.roll(placed, (-self.radius[0], -self.radius[1]), axis=(0, 1))
        transfer = np.fft.rfft2(placed)
        kind = torch.complex64 if dtype == torch.float32 else torch.complex128
        if np.abs(transfer.imag).max() < 1e-12:  # of a symmetric kernel: half the memory, where photos have one each
            self.transfer = torch.from_numpy(transfer.real.copy()).to(device=device, dtype=dtype)
        else:
            self.transfer = torch.from_numpy(transfer).to(device=device, dtype=kind)

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        (rv, rh), f = self.radius, self.frame
        spectrum = torch.fft.rfft2(extended(frame, rv - f.margin, rh - f.margin), s=self.size)
        out = torch.fft.irfft2(spectrum * self.transfer, s=self.size)
        return out[:, rv : rv + f.height, rh : rh + f.width].contiguous()

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        (rv, rh), f = self.radius, self.frame
        embedded = torch.nn.functional.pad(photo, (rh, 0, rv, 0))
        out = torch.fft.irfft2(torch.fft.rfft2(embedded, s=self.size) * self.transfer.conj(), s=self.size)
        return folded(out[:, : f.height + 2 * rv, : f.width + 2 * rh], rv - f.margin, rh - f.margin).contiguous()


class Reduced:
    """Two narrower Gaussians with a coarse grid between them, as products of small matrices.

    The first blurs by sigma/sqrt(2) and keeps every `step`-th px, the second interpolates back with
    sigma/sqrt(2). What the coarse grid folds over is damped by exp(-(pi sigma / step)^2 / 2).

    Attributes:
        bound: largest possible difference to the blur by the Gaussian cut at 6 sigma, as a share of the frame's range,
            computed from the matrices (half of both axes' maximum absolute row sums).
    """

    name = "reduced"

    def __init__(
        self, vertical: float, horizontal: float, frame: Frame, dtype: torch.dtype, device: torch.device
    ) -> None:
        self.bound = 0.0
        factors: list[Tensor] = []
        for sigma, inside in ((vertical, frame.height), (horizontal, frame.width)):
            down, up, bound = reduced_factors(sigma, inside, frame.margin)
            self.bound += bound
            factors += [torch.from_numpy(m).to(device=device, dtype=dtype) for m in (down, up)]
        self.down_v, self.up_v, self.down_h, self.up_h = factors

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        return self.up_v @ (self.down_v @ frame @ self.down_h.T) @ self.up_h.T

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        return self.down_v.T @ (self.up_v.T @ photo @ self.up_h) @ self.down_h


def blur_matrix(taps: Array, inside: int, margin: int) -> Array:
    """[inside, inside + 2 margin]: one axis of the blur, the edge repeated beyond the margin."""
    radius, total = taps.size // 2, inside + 2 * margin
    rows = np.arange(inside)[:, None]
    columns = np.clip(rows + margin + np.arange(-radius, radius + 1)[None, :], 0, total - 1)
    matrix = np.zeros((inside, total))
    np.add.at(matrix, (np.broadcast_to(rows, columns.shape), columns), np.broadcast_to(taps, columns.shape))
    return matrix


def reduced_factors(sigma: float, inside: int, margin: int) -> tuple[Array, Array, float]:
    """(down [n, inside + 2 margin], up [inside, n], bound) with up @ down close to the blur's matrix."""
    total = inside + 2 * margin
    step = max(1.0, REDUCED.step * sigma)
    half = sigma / math.sqrt(2.0)
    reach = REDUCED.reach * half
    count = math.ceil((inside + 2 * reach) / step) + 1
    nodes = (inside - 1) / 2 + margin + (np.arange(count) - (count - 1) / 2) * step

    def weights(distance: Array) -> Array:
        return np.where(abs(distance) <= reach, np.exp(-0.5 * (distance / half) ** 2), 0.0)

    beyond = math.ceil(2 * reach + step)
    fine = np.arange(-beyond, total + beyond)
    spread = weights(nodes[:, None] - fine[None, :])
    spread /= spread.sum(axis=1, keepdims=True)
    down = np.zeros((count, total))
    np.add.at(down.T, np.clip(fine, 0, total - 1), spread.T)
    up = weights(np.arange(inside)[:, None] + margin - nodes[None, :])
    up /= up.sum(axis=1, keepdims=True)
    # Rows of the difference sum to 0, so values in [0, 1] count by their distance from 1/2.
    bound = 0.5 * float(
        np.abs(up @ down - blur_matrix(gaussian_taps(sigma, REDUCED.reference_reach), inside, margin)).sum(axis=1).max()
    )
    return down, up, bound


def candidates(psf: PointSpread, frame: Frame, dtype: torch.dtype, device: torch.device) -> dict[str, Evaluation]:
    """Every evaluation that is valid for this PSF, frame and device, by name."""
    kernel, separable = psf.kernel(), psf.separable()
    found: dict[str, Evaluation] = {"fourier": Fourier(kernel, frame, dtype, device)}
    symmetric = separable is not None and all(np.allclose(t, t[::-1], rtol=0, atol=1e-8) for t in separable)
    found |= backend_on(device).blurs(kernel, separable if symmetric else None, frame, dtype)
    if separable is not None and psf.samples is None and min(psf.sigma_x, psf.sigma_y) >= REDUCED.smallest_sigma:
        wide = [psf.sigma_y, psf.sigma_x]
        if psf.angle % 180.0 == 90.0:
            wide.reverse()
        reduced = Reduced(wide[0], wide[1], frame, dtype, device)
        if reduced.bound < REDUCED.tolerance:
            found["reduced"] = reduced
    return found
