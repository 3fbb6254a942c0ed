"""What `core.devices` asks of a back end, on any maker's graphics card."""

from __future__ import annotations

from torch import Tensor

from ...camera import Camera
from ...gaussians import Gaussians
from ...rendering import RasterSettings, Rendered
from ..reference import ReferenceBackend
from .card import card
from .rasterizer import render_gpu
from .tensors import register


class GpuBackend(ReferenceBackend):
    """See `core.devices.Backend`."""

    def check(self) -> None:
        """See `Backend`; from here on 'gpu' is a device of torch's."""
        register()

    def synchronize(self) -> None:
        """See `Backend`."""
        card().wait()

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


BACKEND = GpuBackend()
