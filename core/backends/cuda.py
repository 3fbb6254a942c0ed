"""NVIDIA cards: gsplat renders, plain torch does the rest."""

from __future__ import annotations

from importlib import metadata

import torch
from torch import Tensor

from ..camera import Camera
from ..errors import DeviceError
from ..gaussians import Gaussians
from ..rasterizer.cuda import render_cuda
from ..rendering import RasterSettings, Rendered
from .reference import ReferenceBackend


class CudaBackend(ReferenceBackend):
    """See `core.devices.Backend`."""

    def check(self) -> None:
        """See `Backend`."""
        if not torch.cuda.is_available():
            raise DeviceError(
                "There is no CUDA device that torch can use", "Use --device cpu, or install torch for CUDA"
            )
        try:
            metadata.version("gsplat")
        except metadata.PackageNotFoundError as error:
            raise DeviceError("The CUDA back end needs gsplat", "Run: pip install gsplat") from error

    def synchronize(self) -> None:
        """See `Backend`."""
        torch.cuda.synchronize()

    def settled(self, tensor: Tensor) -> Tensor:
        """See `Backend`."""
        return tensor.cuda()

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        background: Tensor | None,
        pose: Tensor | None,
        settings: RasterSettings,
    ) -> Rendered:
        """See `Backend`."""
        return render_cuda(gaussians, camera, background, pose, settings)


BACKEND = CudaBackend()
