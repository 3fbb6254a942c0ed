"""What drives the sharp render: the photo, the inverted blur, and a little smoothness.

The paper's loss (MAE + SSIM between the degraded render H x and the photo y) reaches the render x
through the adjoint H', which is tiny just where the medium left little: the loss looks finished
while the finest band that the photos still hold is missing. The inverted residual mends that:

    d = W (y - H x),   W = H' / (|H|^2 + n)                                    (Wiener's inverse)

is what is missing in x itself, in the band that the photos hold (|H|^2 > n), and nothing outside
it. The residual is measured inside the photo only and taken as zero beyond, so no border has to be
invented. x is drawn towards x + d by a pseudo-Huber difference, so that a few photos that disagree
do not outvote the rest.

A run starts on photos that were sharpened once and for all, y + W (y - H y): they show at once where
edges lie, which the residual of a shapeless twin does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import SupportsFloat

import torch
from torch import Tensor

from ...colour import linear_to_srgb
from ...devices import Missing, backend_on
from ...forward import medium_of
from ...frames import Frame
from ...imaging.fourier import FourierFilter
from ...imaging.medium import BlurSpace
from ...imaging.psf import PointSpread
from ...imaging.spectrum import NoiseToSignal
from ...numbers import number
from ..settings import TrainingSettings


@dataclass(frozen=True)
class ObjectiveSettings:
    """Numbers of the inverted residual, besides those of `TrainingSettings`."""

    minimum_derivative: float = number(
        0.1,
        "linear light per sRGB",
        "of the decoding curve that an inverted residual in linear light is divided by: the curve is flat in the dark,"
        " where noise would be lifted without limit",
    )


OBJECTIVE = ObjectiveSettings()


@dataclass(frozen=True)
class LossAndGradient:
    """What one photo asks of the render: loss value, and its gradient [3, H + 2m, W + 2m]."""

    loss: SupportsFloat
    gradient: Tensor


class Inverse:
    """Wiener's inverse of one point spread on frames of one size, brightness and colour apart.

    Args:
        height, width: of the frames, margins included; beyond them the residual is zero.
        ratio: noise over signal at every frequency.
    """

    def __init__(self, psf: PointSpread, height: int, width: int, ratio: NoiseToSignal, device: torch.device) -> None:
        brightness, colour = (
            FourierFilter(psf, (height, width), table, "wiener", "zero", device)
            for table in (ratio.brightness, ratio.colour)
        )
        self.height, self.width, self.size = height, width, brightness.size
        self._colour = colour.transfer
        self._difference = (brightness.transfer - colour.transfer) / 3.0

    def apply(self, residual: Tensor) -> Tensor:
        """What is missing in the sharp frame [3, height, width], given the photo's residual there, or on `size`.

        Brightness is the mean over the channels: T' diag(Wb, Wc, Wc) T = Wc + (Wb - Wc) 11'/3.
        """
        spectrum = torch.fft.rfft2(residual, s=self.size)
        spectrum = backend_on(residual.device).filter_colours(spectrum, self._colour, self._difference)
        return torch.fft.irfft2(spectrum, s=self.size)[:, : self.height, : self.width]


class Objective:
    """The objective for one grid, PSF and margin; photos come one at a time.

    Args:
        psf: the point spread on this grid, None for none.
        frame: the photos' size on this grid, and the margin that the render is larger by on every side.
        space: in which the blur is linear.
        ratio: noise over signal of the photos on this grid; None where nothing is inverted.
        contrast: of the sharp scene on this grid (`contrast.scene_contrast`), the unit of differences.
    """

    def __init__(
        self,
        psf: PointSpread | None,
        frame: Frame,
        space: BlurSpace,
        settings: TrainingSettings,
        device: torch.device,
        ratio: NoiseToSignal | None = None,
        contrast: float = 0.2,
    ) -> None:
        self.settings, self.margin, self.space, self.device = settings, frame.margin, space, device
        self.knee, self.inverse_width = settings.variation_knee * contrast, settings.inverse_width * contrast
        if settings.blur_evaluation == "splats":  # the splats themselves are widened: see `Trainer.raster_settings`
            psf, evaluation = None, "auto"
        else:
            evaluation = settings.blur_evaluation
        self.medium = medium_of(psf, frame, space, device, evaluation=evaluation)
        self.inverse = None
        if psf is not None and ratio is not None:
            self.inverse = Inverse(psf, *frame.rendered, ratio, device)

    def loss(self, image: Tensor, photo: Tensor, valid: Tensor | None) -> LossAndGradient:
        """Loss of a render [3, H + 2m, W + 2m] against the photo [3, H, W], both sRGB, and its gradient."""
        s, backend, m, count = self.settings, backend_on(image.device), self.margin, photo.numel()
        passed = self.medium.passed(image)
        weight = 1.0 if self.inverse is None else s.base_weight
        if weight:
            degraded = self.medium.encoded(passed.blurred)
            loss, upstream = self._compare(degraded, photo, valid, s.ssim_weight)
            gradient = self.medium.pulled_back(upstream, passed, degraded, weight)
        else:
            loss, gradient = 0.0, torch.zeros_like(image)
        if s.variation_weight and s.loss != "paper":
            gradient = backend.add_variation(gradient, image, self.knee, s.variation_weight / count)
        if self.inverse is None:
            return LossAndGradient(loss, gradient)
        if s.speck_weight:
            gradient = backend.add_specks(gradient, image, s.speck_weight / count)
        residual = backend.residual(self.medium.decoded(photo), passed.blurred, valid, m, self.inverse.size)
        if not weight:
            loss = float(residual[self._inner(photo)].abs().mean())
        values = self.inverse.apply(residual)
        curve = (image, passed.light, OBJECTIVE.minimum_derivative) if self.space == "linear" else None
        missing = Missing(values, m, valid, self.inverse_width, s.inverse_weight / count, curve)
        backend.draw(gradient, missing)
        return LossAndGradient(loss, gradient)

    def start_loss(self, image: Tensor, photo: Tensor, valid: Tensor | None) -> LossAndGradient:
        """The same against the photo with its blur undone once and for all; arguments as of `loss`."""
        assert self.inverse is not None
        s, m = self.settings, self.margin
        inner_photo = self.medium.decoded(photo)
        if valid is not None:  # what does not count must not be blurred into what does
            inner_photo = torch.where(valid, inner_photo, inner_photo[:, valid].mean(dim=1)[:, None, None])
        wide = torch.nn.functional.pad(inner_photo[None], (m, m, m, m), mode="replicate")[0]
        residual = inner_photo - self.medium.blur.apply(wide)
        (rows, columns), inner = self.inverse.size, self._inner(photo)
        placed = torch.nn.functional.pad(residual, (m, columns - m - photo.shape[2], m, rows - m - photo.shape[1]))
        sharp = inner_photo + self.inverse.apply(placed)[inner]
        if self.space == "linear":
            sharp = linear_to_srgb(sharp.clamp(min=0.0))
        weight = s.variation_weight / photo.numel()
        gradient = backend_on(image.device).add_variation(None, image, self.knee, weight)
        loss, in_sharpened = self._compare(image[inner].contiguous(), sharp, valid, s.ssim_weight)
        gradient[inner] += in_sharpened
        return LossAndGradient(loss, gradient)

    def _inner(self, photo: Tensor) -> tuple[slice, slice, slice]:
        """Where the photo lies in a frame that begins with the margin."""
        m = self.margin
        return slice(None), slice(m, m + photo.shape[1]), slice(m, m + photo.shape[2])

    def _compare(
        self, image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
    ) -> tuple[SupportsFloat, Tensor]:
        return backend_on(image.device).photometric(image, photo, valid, ssim_weight)
