"""The rasterizer's door."""

from __future__ import annotations

import torch
from torch import Tensor

from ..camera import Camera
from ..devices import BackendName, backend_named, backend_on
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered


def render(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Tensor | None = None,
    pose: Tensor | None = None,
    settings: RasterSettings = RasterSettings(),
    backend: BackendName = "auto",
) -> Rendered:
    """Projects, sorts and blends all Gaussians into one view (Kerbl et al. 2023; Zwicker's EWA).

    Args:
        gaussians: raw parameters; float32 (float64 on the reference back end too).
        camera: size and lens, and the pose unless `pose` is given.
        background: [3] colour behind everything; black if None.
        pose: [3, 4] world to camera, differentiable; the camera's own if None.
        settings: see `RasterSettings`.
        backend: a name of `core.devices`; 'auto' takes the one whose device the tensors are on, 'reference' for other
            types than float32.

    Returns:
        The view; gradients flow to all five parameters, the background and the pose.

    Raises:
        DeviceError: the back end does not fit the tensors or is not installed.
    """
    if backend == "auto":
        single = gaussians.means.dtype == torch.float32
        found = backend_on(gaussians.means.device) if single else backend_named("reference")
    else:
        found = backend_named(backend)
    return found.render(gaussians, camera, background, pose, settings)
