"""What pulls at the sharp render: the photo, the inverted blur, and a little smoothness.

The paper's loss (MAE + SSIM between the degraded render H x and the photo y) reaches the render x
through the adjoint H', which is tiny just where the medium left little: the loss looks finished
while the finest band that the photos still hold is missing. The inverted residual mends that:

    d = W (y - H x),   W = H' / (|H|^2 + n)                                    (Wiener's inverse)

is what is missing in x itself, in the band that the photos hold (|H|^2 > n), and nothing outside
it. The residual is known inside the photo only and taken as zero beyond, so no border has to be
invented. x is drawn towards x + d by MAE + SSIM, as robust against single wild pixels as the
photo's own loss.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
import torch
from torch import Tensor

from ..colour import linear_to_srgb, srgb_to_linear
from ..imaging.medium import BlurSpace
from ..imaging.operator import BlurOperator
from ..imaging.psf import PointSpread
from .photometric import PhotometricLoss, photometric_reference
from .settings import TrainingSettings
from .variation import variation_gradient


@dataclass(frozen=True)
class Pull:
    """What one photo asks of the render: loss value, and its gradient [3, H + 2m, W + 2m]."""

    loss: float
    gradient: Tensor


class Inverse:
    """The Wiener inverse W of one point spread on frames of one size."""

    def __init__(self, psf: PointSpread, height: int, width: int, noise_to_signal: float, device: torch.device) -> None:
        self.height, self.width = height, width
        kernel = psf.kernel()
        reach = max(kernel.shape)
        # zeros around the frame so that nothing wraps from one side to the other
        self.size = (scipy.fft.next_fast_len(height + reach, real=True), scipy.fft.next_fast_len(width + reach, real=True))
        padded = np.zeros(self.size)
        padded[: kernel.shape[0], : kernel.shape[1]] = kernel
        padded = np.roll(padded, (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2)), (0, 1))
        transfer = np.fft.rfft2(padded)
        power = np.abs(transfer) ** 2
        weight = np.conj(transfer) / (power + noise_to_signal)
        self.weight = torch.from_numpy(weight).to(device, torch.complex64)
        self.passed = torch.from_numpy(power / (power + noise_to_signal)).to(device, torch.float32)

    def _filter(self, frame: Tensor, weight: Tensor) -> Tensor:
        spectrum = torch.fft.rfft2(frame, s=self.size)
        return torch.fft.irfft2(spectrum * weight, s=self.size)[:, : self.height, : self.width]

    def apply(self, residual: Tensor) -> Tensor:
        """W times a frame [C, height, width]."""
        return self._filter(residual, self.weight)

    def passband(self, frame: Tensor) -> Tensor:
        """M = |H|^2 / (|H|^2 + n) times a frame: what of it the photos could hold."""
        return self._filter(frame, self.passed)


class Objective:
    """The objective for one grid, PSF and margin; photos come one at a time.

    Args:
        psf: the point spread on this grid, None for none.
        height, width: the photos' size on this grid.
        margin: px the render is larger on every side.
    """

    def __init__(self, psf: PointSpread | None, height: int, width: int, margin: int, space: BlurSpace,
                 settings: TrainingSettings, device: torch.device) -> None:  # fmt: skip
        self.settings, self.margin, self.space, self.device = settings, margin, space, device
        self.blur = BlurOperator(psf, height, width, margin, device)
        self.inverse = None
        if psf is not None and settings.loss == "dgs":
            self.inverse = Inverse(psf, height + 2 * margin, width + 2 * margin, settings.noise_to_signal, device)

    def pull(self, image: Tensor, photo: Tensor, valid: Tensor | None) -> Pull:
        """How the photo [3, H, W] pulls at a render [3, H + 2m, W + 2m], both sRGB."""
        s = self.settings
        light = image if self.space == "srgb" else srgb_to_linear(image)
        blurred = self.blur.apply(light)
        degraded = blurred if self.space == "srgb" else linear_to_srgb(blurred)
        loss, slope = self._compare(degraded, photo, valid)
        if self.space == "linear":
            slope = slope * _slope(linear_to_srgb, blurred)
        gradient = self.blur.adjoint(slope)
        if self.space == "linear":
            gradient = gradient * _slope(srgb_to_linear, image)
        if self.inverse is None:
            return Pull(loss, gradient)
        gradient = gradient * s.base_weight
        known = photo if self.space == "srgb" else srgb_to_linear(photo)
        residual = known - blurred
        residual = torch.where(residual.isfinite() if valid is None else residual.isfinite() & valid, residual, 0.0)
        m = self.margin
        missing = self.inverse.apply(torch.nn.functional.pad(residual, (m, m, m, m)))
        if self.space == "linear":
            missing = missing / _slope(srgb_to_linear, image).clamp(min=0.1)
        inner = (slice(None), slice(m, m + photo.shape[1]), slice(m, m + photo.shape[2]))
        if s.inverse_weight:
            sharp = (self.inverse.passband(image) if s.passband else image)[inner].contiguous()
            _, sharp_slope = self._compare(sharp, sharp + missing[inner], valid)
            gradient[inner] += s.inverse_weight * sharp_slope
        if s.newton_weight:
            gradient -= (s.newton_weight / photo.numel()) * missing
        if s.variation_weight:
            gradient += (s.variation_weight / photo.numel()) * variation_gradient(image)
        return Pull(loss, gradient)

    def _compare(self, image: Tensor, photo: Tensor, valid: Tensor | None) -> tuple[float, Tensor]:
        if not image.is_cuda:
            return PhotometricLoss(photo, valid, self.settings.ssim_weight).value_and_gradient(image)
        leaf = image.detach().requires_grad_()
        loss = photometric_reference(leaf, photo, valid, self.settings.ssim_weight)
        loss.backward()  # type: ignore[no-untyped-call]
        assert leaf.grad is not None
        return float(loss), leaf.grad


def _slope(curve: object, at: Tensor) -> Tensor:
    """Derivative of an elementwise function."""
    leaf = at.detach().requires_grad_()
    with torch.enable_grad():
        (out,) = torch.autograd.grad(curve(leaf).sum(), leaf)  # type: ignore[operator]
    return out
