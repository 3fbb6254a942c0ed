"""Plain torch on any device, float32 and float64: the specification of every other back end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import SupportsFloat

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..colour import decoding_derivative
from ..devices import AdamStep, Guarded, LevelCurve, Missing, Tent
from ..frames import Evaluation, Frame
from ..gaussians import Gaussians
from ..imaging.formation.layered import layer_gathered, layer_returned, layer_weighed
from ..rasterizer.depths import surface_of_centres
from ..rasterizer.reference import render_layers_reference, render_reference
from ..rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath
from ..training.density.contribution import add_seen_in_torch
from ..training.guards import guarded_in_torch
from ..training.loss.photometric import photometric_reference
from ..training.loss.specks import speck_gradient_in_torch
from ..training.loss.variation import variation_gradient_in_torch
from ..training.optics.exposures import reexposed_in_torch


class ReferenceBackend:
    """See `core.devices.Backend`; others inherit what they have no faster way for."""

    one_width = "fourier"
    photo_bytes = 0

    def check(self) -> None:
        """Works everywhere."""

    def quick(self) -> bool:
        """See `Backend`: it is the specification."""
        return False

    def warm(self) -> None:
        """See `Backend`: nothing is worth a thread."""

    def synchronize(self) -> None:
        """Nothing is left to be waited for."""

    def settled(self, tensor: Tensor) -> Tensor:
        """See `Backend`."""
        return tensor

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        background: Tensor | None,
        pose: Tensor | None,
        settings: RasterSettings,
    ) -> Rendered:
        """See `Backend`."""
        return render_reference(gaussians, camera, background, pose, settings)

    def render_path(
        self, gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
    ) -> RenderedPath:
        """See `Backend`: one frame after the other."""
        frames = [self.render(gaussians, camera, background, pose, settings) for pose in poses.to(gaussians.means)]
        return RenderedPath(torch.stack([frame.image for frame in frames]), tuple(frame.screen for frame in frames))

    def render_layers(
        self, gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
    ) -> RenderedLayers:
        """See `Backend`."""
        return render_layers_reference(gaussians, camera, place, background, settings)

    def surface_of_centres(self, gaussians: Gaussians, camera: Camera, settings: RasterSettings, held: float) -> Tensor:
        """See `Backend`: by the compiled kernels, of single precision."""
        there = gaussians.to(device="cpu", dtype=torch.float32)
        found = surface_of_centres(there, camera, settings, held=held)
        return torch.from_numpy(np.nan_to_num(found)).to(gaussians.means)

    def blurs(
        self, kernel: NDArray, taps: tuple[NDArray, NDArray] | None, frame: Frame, dtype: torch.dtype
    ) -> dict[str, Evaluation]:
        """See `Backend`: none but those of every device."""
        return {}

    def photometric(
        self, image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
    ) -> tuple[SupportsFloat, Tensor]:
        """See `Backend`."""
        leaf = image.detach().requires_grad_()
        loss = photometric_reference(leaf, photo, valid, ssim_weight)
        loss.backward()  # type: ignore[no-untyped-call]
        assert leaf.grad is not None
        return float(loss.detach()), leaf.grad

    def variation_gradient(self, image: Tensor, knee: float) -> Tensor:
        """See `Backend`."""
        return variation_gradient_in_torch(image, knee)

    def speck_gradient(self, image: Tensor) -> Tensor:
        """See `Backend`."""
        return speck_gradient_in_torch(image)

    def add_variation(self, into: Tensor | None, image: Tensor, knee: float, weight: float) -> Tensor:
        """See `Backend`."""
        found = weight * self.variation_gradient(image, knee)
        return found if into is None else into.add_(found)

    def add_specks(self, into: Tensor | None, image: Tensor, weight: float) -> Tensor:
        """See `Backend`."""
        found = weight * self.speck_gradient(image)
        return found if into is None else into.add_(found)

    def residual(
        self, photo: Tensor, blurred: Tensor, valid: Tensor | None, margin: int, size: tuple[int, int]
    ) -> Tensor:
        """See `Backend`."""
        found = photo - blurred
        counts = found.isfinite() if valid is None else found.isfinite() & valid
        found = torch.where(counts, found, 0.0)
        beyond = size[1] - margin - found.shape[2], size[0] - margin - found.shape[1]
        return torch.nn.functional.pad(found, (margin, beyond[0], margin, beyond[1]))

    def filter_colours(self, spectrum: Tensor, own: Tensor, shared: Tensor) -> Tensor:
        """See `Backend`."""
        together = spectrum.sum(dim=0) * shared
        return spectrum.mul_(own).add_(together)

    def draw(self, gradient: Tensor, missing: Missing) -> None:
        """See `Backend`."""
        m, d = missing.margin, missing.values
        if missing.curve is not None:
            image, light, least = missing.curve
            d = d / decoding_derivative(image, light).clamp(min=least)
        inner = (slice(None), slice(m, gradient.shape[1] - m), slice(m, gradient.shape[2] - m))
        d = d[inner]
        d = d / (d.square() + missing.width**2).sqrt() if missing.width else d.sign()
        if missing.valid is not None:
            d = d * missing.valid
        gradient[inner] -= missing.weight * d

    def collect(self, centres: Tensor, radius: Tensor, gradients: Tensor, views: Tensor) -> None:
        """See `Backend`."""
        gradients += centres.norm(dim=1).to(gradients.device)
        views += (radius > 0).to(views.device, views.dtype)

    def reexposed(self, photo: Tensor, shown: Tensor, curve: LevelCurve) -> Tensor:
        """See `Backend`."""
        return reexposed_in_torch(photo, shown, curve)

    def add_seen(
        self,
        sums: tuple[Tensor, Tensor, Tensor],
        gradient: Tensor,
        gaussians: Gaussians,
        camera: Camera,
        settings: RasterSettings,
    ) -> None:
        """See `Backend`."""
        add_seen_in_torch(sums, gradient, gaussians, camera, settings)

    def guard(self, gaussians: Gaussians, centres: Tensor) -> Guarded:
        """See `Backend`."""
        return guarded_in_torch(gaussians, centres)

    def adam(self, steps: Sequence[AdamStep]) -> None:
        """See `Backend`."""
        for step in steps:
            self._step(step)

    def _step(self, step: AdamStep) -> None:
        finite = step.gradient.isfinite()
        gradient = torch.where(finite, step.gradient, 0)
        step.first.lerp_(gradient, 1 - step.betas[0])
        step.second.mul_(step.betas[1]).addcmul_(gradient, gradient, value=1 - step.betas[1])
        move = step.first / step.second.sqrt().mul_(step.correction).add_(step.epsilon)
        if step.leading is None:
            step.values.sub_(step.rate * move)
        else:
            values, moves = (t.reshape(len(t), -1) for t in (step.values, move))
            values[:, : step.leading] -= step.rate * moves[:, : step.leading]
            values[:, step.leading :] -= step.tail * moves[:, step.leading :]
        step.refused.add_((~finite).sum().to(step.refused.dtype))

    def layer_weighed(self, light: Tensor, variance: Tensor, tent: Tent) -> Tensor:
        """See `Backend`."""
        return layer_weighed(light, variance, tent)

    def layer_gathered(
        self, back: Tensor, light: Tensor, variance: Tensor, tent: Tent, gradients: tuple[Tensor, Tensor]
    ) -> None:
        """See `Backend`."""
        layer_gathered(back, light, variance, tent, gradients)

    def layer_returned(
        self, together: Tensor, seen: Tensor | None, behind: tuple[Tensor, Tensor] | None, hides: Tensor
    ) -> Tensor:
        """See `Backend`."""
        return layer_returned(together, seen, behind, hides)


BACKEND = ReferenceBackend()
