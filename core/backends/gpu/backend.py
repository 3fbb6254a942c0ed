"""What `core.devices` asks of a back end, on any maker's graphics card."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import SupportsFloat

import torch
from numpy.typing import NDArray
from torch import Tensor

from ...camera import Camera
from ...devices import AdamStep, Guarded, LevelCurve, Missing
from ...errors import DeviceError
from ...frames import Evaluation, Frame
from ...gaussians import Gaussians
from ...numbers import number
from ...rasterizer.layers_by_renders import render_layers_by_renders
from ...rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath
from ...warming import finish_warming
from ..cpu import CPU, CpuBackend
from ..reference import ReferenceBackend
from . import arithmetic, reductions, rows, transforms  # noqa: F401  (torch's operations find them)
from .adam import adam_steps
from .adapter import adapters, may_have_card
from .blurs import blurs_on_card
from .card import card
from .collect import collected_on_card, seen_on_card
from .exposures import reexposed_on_card
from .guards import guarded_on_card
from .losses import photometric_on_card, specks_on_card, variation_on_card
from .missing import drawn_on_card, filtered_on_card, residual_on_card
from .rasterizer import render_gpu, render_path_gpu, surface_gpu
from .ready import make_ready
from .tensors import CardTensor, from_host, register
from .through_host import ThroughHost


@dataclass(frozen=True)
class CardSettings:
    """Numbers of the card's back end; they change how long it takes, and nothing else."""

    photo_bytes: int = number(
        1 << 30,
        "bytes",
        "of photos that stay on the card: 200 of 800 x 533 px, and a quarter of the memory of a small card",
        "not chosen by data",
    )


CARD = CardSettings()


class GpuBackend(ReferenceBackend):
    """See `core.devices.Backend`."""

    one_width = "separable"
    photo_bytes = CARD.photo_bytes

    def __init__(self) -> None:
        self._host = CpuBackend()

    def check(self) -> None:
        """See `Backend`; from here on 'gpu' is a device of torch's."""
        register()

    def quick(self) -> bool:
        """See `Backend`: a card with memory of its own."""
        finish_warming()
        try:
            return may_have_card() and bool(adapters()[0].info["adapter_type"] == "DiscreteGPU")
        except DeviceError:
            return False

    def warm(self) -> None:
        """See `Backend`."""
        register()
        make_ready(card())

    def synchronize(self) -> None:
        """See `Backend`."""
        card().wait()

    def settled(self, tensor: Tensor) -> Tensor:
        """See `Backend`."""
        found = tensor if isinstance(tensor, CardTensor) else from_host(tensor)
        found.held.for_card()
        return found

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        background: Tensor | None,
        pose: Tensor | None,
        settings: RasterSettings,
    ) -> Rendered:
        """See `Backend`."""
        return render_gpu(gaussians, camera, background, pose, settings)

    def render_path(
        self, gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
    ) -> RenderedPath:
        """See `Backend`."""
        return render_path_gpu(gaussians, camera, background, poses, settings)

    def render_layers(
        self, gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
    ) -> RenderedLayers:
        """See `Backend`."""
        return render_layers_by_renders(self.render, gaussians, camera, place, background, settings)

    def surface_of_centres(self, gaussians: Gaussians, camera: Camera, settings: RasterSettings, held: float) -> Tensor:
        """See `Backend`."""
        return surface_gpu(gaussians, camera, settings, held)

    def blurs(
        self, kernel: NDArray, taps: tuple[NDArray, NDArray] | None, frame: Frame, dtype: torch.dtype
    ) -> dict[str, Evaluation]:
        """See `Backend`."""
        if dtype != torch.float32:
            return {name: ThroughHost(found) for name, found in self._host.blurs(kernel, taps, frame, dtype).items()}
        return dict(blurs_on_card(kernel, taps, frame, CPU.direct_taps))

    def photometric(
        self, image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
    ) -> tuple[SupportsFloat, Tensor]:
        """See `Backend`."""
        return photometric_on_card(image, photo, valid, ssim_weight)

    def variation_gradient(self, image: Tensor, knee: float) -> Tensor:
        """See `Backend`."""
        return variation_on_card(image, knee)

    def speck_gradient(self, image: Tensor) -> Tensor:
        """See `Backend`."""
        return specks_on_card(image)

    def add_variation(self, into: Tensor | None, image: Tensor, knee: float, weight: float) -> Tensor:
        """See `Backend`."""
        return variation_on_card(image, knee, weight, into)

    def add_specks(self, into: Tensor | None, image: Tensor, weight: float) -> Tensor:
        """See `Backend`."""
        return specks_on_card(image, weight, into)

    def residual(
        self, photo: Tensor, blurred: Tensor, valid: Tensor | None, margin: int, size: tuple[int, int]
    ) -> Tensor:
        """See `Backend`."""
        return residual_on_card(photo, blurred, valid, margin, size)

    def filter_colours(self, spectrum: Tensor, own: Tensor, shared: Tensor) -> Tensor:
        """See `Backend`."""
        if filtered_on_card(spectrum, own, shared):
            return spectrum
        return super().filter_colours(spectrum, own, shared)

    def draw(self, gradient: Tensor, missing: Missing) -> None:
        """See `Backend`."""
        if not drawn_on_card(gradient, missing):
            super().draw(gradient, missing)

    def collect(self, centres: Tensor, radius: Tensor, gradients: Tensor, views: Tensor) -> None:
        """See `Backend`."""
        if not collected_on_card(centres, radius, gradients, views):
            super().collect(centres, radius, gradients, views)

    def reexposed(self, photo: Tensor, shown: Tensor, curve: LevelCurve) -> Tensor:
        """See `Backend`."""
        return reexposed_on_card(photo, shown, curve)

    def add_seen(
        self,
        sums: tuple[Tensor, Tensor, Tensor],
        gradient: Tensor,
        gaussians: Gaussians,
        camera: Camera,
        settings: RasterSettings,
    ) -> None:
        """See `Backend`."""
        seen_on_card(sums, gradient, gaussians, camera, settings)

    def guard(self, gaussians: Gaussians, centres: Tensor) -> Guarded:
        """See `Backend`."""
        return guarded_on_card(gaussians, centres)

    def adam(self, steps: Sequence[AdamStep]) -> None:
        """See `Backend`."""
        adam_steps(steps)


BACKEND = GpuBackend()
