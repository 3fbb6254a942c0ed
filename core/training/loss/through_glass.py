"""What drives the sharp render where the blur follows from the depth: `objective`, with an inverse for every width.

The residual is inverted by Wiener's filter for each rung of a ladder of widths, and each px takes the mixture of the
two next to its own width. The render is asked at the place of the sharp frame, in front of the glass's blur.
"""

from __future__ import annotations

import math
from typing import NamedTuple, SupportsFloat

import torch
from torch import Tensor

from ...camera import Camera
from ...colour import decoding_derivative, linear_to_srgb, srgb_to_linear
from ...devices import backend_on
from ...forward import Exposed
from ...frames import Frame
from ...imaging.formation.glass import FrostedGlass
from ...imaging.formation.layered import LADDER, tent_of
from ...imaging.fourier import fast_size, transfer_on
from ...imaging.psf import PointSpread
from ...imaging.spectrum import NoiseToSignal
from ..settings import TrainingSettings
from .objective import OBJECTIVE
from .specks import speck_gradient
from .variation import variation_gradient


class TwoGradients(NamedTuple):
    """What one photo asks: loss value, and gradients [3, h, w] in the degraded frame and in the sharp one."""

    loss: SupportsFloat
    in_reached: Tensor
    in_sharp: Tensor


class InverseByWidth:
    """Wiener's inverses of Gaussians, mixed by each px' own width; `objective.Inverse` for a ladder of widths.

    Args:
        height, width: of the frames, margins included; beyond them the residual is zero.
        ratio: noise over signal at every frequency; widest: px, standard deviation.
    """

    def __init__(self, height: int, width: int, ratio: NoiseToSignal, widest: float, device: torch.device) -> None:
        self.height, self.width, self._ratio, self._device = height, width, ratio, device
        self._sigmas = LADDER[: sum(1 for sigma in LADDER if sigma < widest) + 1]
        self.size = fast_size(_round(self._sigmas[-1]), height, width)
        self._transfers: dict[int, tuple[Tensor, Tensor]] = {}

    def apply(self, residual: Tensor, sigma: Tensor) -> Tensor:
        """What is missing in the sharp frame [3, height, width], given the residual and widths [height, width]."""
        variances = [0.0, *(s**2 for s in self._sigmas)]
        place = sigma.square().clamp(max=variances[-1])
        lowest, highest = (float(v) for v in torch.aminmax(place))
        first = max(i for i, v in enumerate(variances) if v <= lowest or i == 0)
        last = next(i for i, v in enumerate(variances) if v >= highest or i == len(variances) - 1)
        if first == last:
            first, last = (first - 1, last) if first else (0, 1)
        used = variances[first : last + 1]
        spectrum, missing = torch.fft.rfft2(residual, s=self.size), torch.zeros_like(residual)
        for k in range(first, last + 1):
            r0, r1, f0, f1 = tent_of(used, k - first)
            weight = torch.minimum(r0 + r1 * place, f0 + f1 * place).clamp(min=0.0)
            missing += weight * (residual if k == 0 else self._inverted(spectrum, k - 1))
        return missing

    def _inverted(self, spectrum: Tensor, rung: int) -> Tensor:
        if rung not in self._transfers:
            psf, tables = _round(self._sigmas[rung]), (self._ratio.brightness, self._ratio.colour)
            brightness, colour = (transfer_on(self.size, psf, t, "wiener", self._device) for t in tables)
            self._transfers[rung] = (brightness - colour) / 3.0, colour
        difference, colour = self._transfers[rung]
        shared = spectrum.sum(dim=0) * difference  # brightness is the mean over the channels, as in `Inverse`
        return torch.fft.irfft2(spectrum * colour + shared, s=self.size)[:, : self.height, : self.width]


def _round(sigma: float) -> PointSpread:
    return PointSpread(sigma_x=sigma, sigma_y=sigma)


def behind_glass(glass: FrostedGlass, name: str, camera: Camera) -> PointSpread | None:
    """The point spread at the scene's unit of depth, px of a camera's frame; None for a photo without the glass."""
    if glass.row_of(name) is None:
        return None
    return _round(glass.sigma(1.0, math.hypot(camera.width, camera.height)))


class GlassObjective:
    """The objective for one grid and photos of one size behind glass; photos come one at a time.

    Args:
        frame: the photos' size on this grid, and the margin that the render is larger by on every side.
        ratio, contrast: as of `Objective`; widest: px of the grid, standard deviation of the widest blur.
    """

    def __init__(
        self,
        frame: Frame,
        settings: TrainingSettings,
        ratio: NoiseToSignal,
        contrast: float,
        widest: float,
        device: torch.device,
    ) -> None:
        self.settings, self.frame = settings, frame
        self.knee, self.inverse_width = settings.variation_knee * contrast, settings.inverse_width * contrast
        self.inverse = InverseByWidth(*frame.rendered, ratio, widest, device)

    def loss(self, exposed: Exposed, glass: FrostedGlass, photo: Tensor, valid: Tensor | None) -> TwoGradients:
        """Loss of what is exposed against the photo [3, H, W] sRGB; see `Objective.loss`."""
        s, inner, (sharp, light) = self.settings, self._inner(), self._sharp(exposed, glass)
        reached = exposed.reached
        loss, in_degraded = self._compare(reached[inner].contiguous(), photo, valid)
        in_reached, in_sharp = torch.zeros_like(reached), torch.zeros_like(sharp)
        in_reached[inner] = s.base_weight * in_degraded
        in_sharp += (s.variation_weight / photo.numel()) * variation_gradient(sharp, self.knee)
        if s.speck_weight:
            in_sharp += (s.speck_weight / photo.numel()) * speck_gradient(sharp)
        residual = srgb_to_linear(photo) - srgb_to_linear(reached[inner])
        residual = torch.where(residual.isfinite() if valid is None else residual.isfinite() & valid, residual, 0.0)
        d = self._missing(residual, exposed, glass, light)
        d = (d / decoding_derivative(sharp, light).clamp(min=OBJECTIVE.minimum_derivative))[inner]
        d = d / (d.square() + self.inverse_width**2).sqrt() if self.inverse_width else d.sign()
        in_sharp[inner] -= (s.inverse_weight / photo.numel()) * (d if valid is None else d * valid)
        return TwoGradients(loss, in_reached, in_sharp)

    def start_loss(self, exposed: Exposed, glass: FrostedGlass, photo: Tensor, valid: Tensor | None) -> TwoGradients:
        """The same against the photo with its blur undone by the twin's present depth; see `Objective.start_loss`."""
        s, m, inner, (sharp, light) = self.settings, self.frame.margin, self._inner(), self._sharp(exposed, glass)
        seen = srgb_to_linear(photo)
        if valid is not None:  # what does not count must not be blurred into what does
            seen = torch.where(valid, seen, seen[:, valid].mean(dim=1)[:, None, None])
        wide = torch.nn.functional.pad(seen[None], (m, m, m, m), mode="replicate")[0]
        residual = seen - glass.forward(wide, exposed.frames[0].passage.shot)[inner]
        found = seen + self._missing(residual, exposed, glass, light)[inner]
        in_sharp = (s.variation_weight / photo.numel()) * variation_gradient(sharp, self.knee)
        wanted = linear_to_srgb(found.clamp(min=0.0))
        loss, in_inner = self._compare(sharp[inner].contiguous(), wanted, valid)
        in_sharp[inner] += in_inner
        return TwoGradients(loss, torch.zeros_like(exposed.reached), in_sharp)

    def _inner(self) -> tuple[slice, slice, slice]:
        m = self.frame.margin
        return slice(None), slice(m, m + self.frame.height), slice(m, m + self.frame.width)

    @staticmethod
    def _sharp(exposed: Exposed, glass: FrostedGlass) -> tuple[Tensor, Tensor]:
        """[3, h, w] the sharp frame, sRGB and light."""
        passage = exposed.frames[0].passage
        return passage.frame, passage.stages[0]

    def _missing(self, residual: Tensor, exposed: Exposed, glass: FrostedGlass, light: Tensor) -> Tensor:
        """[3, h, w] in the sharp frame's light."""
        shot, m = exposed.frames[0].passage.shot, self.frame.margin
        row = glass.row_of(shot.name)
        padded = torch.nn.functional.pad(residual, (m, m, m, m))
        return padded if row is None else self.inverse.apply(padded, glass.width(light, shot, row).abs())

    def _compare(self, image: Tensor, photo: Tensor, valid: Tensor | None) -> tuple[SupportsFloat, Tensor]:
        return backend_on(image.device).photometric(image, photo, valid, self.settings.ssim_weight)
