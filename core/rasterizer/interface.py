"""The rasterizer's door."""

from __future__ import annotations

import torch
from torch import Tensor

from ..camera import Camera
from ..devices import Backend, BackendName, backend_named, backend_on
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath


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
    return _found(gaussians, backend).render(gaussians, camera, background, pose, settings)


def render_path(
    gaussians: Gaussians,
    camera: Camera,
    poses: Tensor,
    *,
    background: Tensor | None = None,
    settings: RasterSettings = RasterSettings(),
    backend: BackendName = "auto",
) -> RenderedPath:
    """What a camera sees from each pose of a short path, as `render` from there; no depth.

    The back end `cpu` projects and sorts once: ellipses, colours and order are those of the middle pose, centres each
    frame's own. Gradients go back through the middle pose.

    Args:
        poses: [K, 3, 4] world to camera, in their order along the path, without gradient; others as of `render`.

    Returns:
        The frames; gradients flow to all five parameters.

    Raises:
        DeviceError: the back end does not fit the tensors or is not installed.
    """
    return _found(gaussians, backend).render_path(gaussians, camera, background, poses, settings)


def render_layers(
    gaussians: Gaussians,
    camera: Camera,
    place: Tensor,
    *,
    background: Tensor | None = None,
    settings: RasterSettings = RasterSettings(),
    backend: BackendName = "auto",
) -> RenderedLayers:
    """One view in layers by distance, for effects that differ with it (a lens out of focus).

    Args:
        place: [N] of each Gaussian along the layers, 0 or more, larger where nearer (`RenderedLayers`); others as of
            `render`.

    Returns:
        The layers; gradients flow to all five parameters, the places and the background.

    Raises:
        DeviceError: the back end does not fit the tensors or is not installed.
    """
    return _found(gaussians, backend).render_layers(gaussians, camera, place, background, settings)


def _found(gaussians: Gaussians, backend: BackendName) -> Backend:
    if backend != "auto":
        return backend_named(backend)
    single = gaussians.means.dtype == torch.float32
    return backend_on(gaussians.means.device) if single else backend_named("reference")
