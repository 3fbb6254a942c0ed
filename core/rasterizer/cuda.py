"""The CUDA back end: gsplat's kernels behind the same door (Ye et al. 2025, gsplat >= 1.5).

Culling is the reference's, so the same Gaussians are dropped and counted; gsplat projects, sorts and
blends the rest. Its kernels (up to 1.5) cap alpha at 0.999 (here 0.99) and leave out the Gaussian that crosses
the transmittance stop; neither can be set from outside, and both change a pixel by less than 0.01.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import ALPHA_MINIMUM, LOG_SCALE_LIMIT, TILE
from ..errors import DeviceError
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, ScreenStatistics
from .projection import camera_pose, select, visible

_INSTALL = (
    "Install PyTorch for CUDA (pytorch.org/get-started), the CUDA toolkit, and then 'pip install gsplat', "
    "or use --device cpu"
)


def available() -> bool:
    """Whether a CUDA device and a working gsplat are here."""
    try:
        _gsplat()
    except DeviceError:
        return False
    return True


def _gsplat() -> Any:
    """The gsplat module, with its kernels built.

    Raises:
        DeviceError: no CUDA device, no gsplat, or a gsplat without kernels.
    """
    if not torch.cuda.is_available():
        raise DeviceError("This PyTorch sees no CUDA device", _INSTALL)
    try:
        import gsplat  # late: only where there is CUDA
        from gsplat.cuda import _backend
    except (ImportError, OSError) as error:
        raise DeviceError(f"gsplat cannot be loaded ({error})", _INSTALL) from error
    if getattr(_backend, "_C", gsplat) is None:
        raise DeviceError("gsplat found no CUDA toolkit to build its kernels with", _INSTALL)
    return gsplat


def _check(gaussians: Gaussians, settings: RasterSettings) -> None:
    if not gaussians.means.is_cuda:
        raise DeviceError("The CUDA back end was given Gaussians in the CPU's memory", "Move them to the device first")
    if gaussians.means.dtype != torch.float32:
        raise DeviceError("The CUDA back end computes in float32 only", "Use the reference back end")
    if settings.alpha_minimum != ALPHA_MINIMUM:
        raise DeviceError(f"gsplat's alpha cutoff is fixed at {ALPHA_MINIMUM:.4f}", "Use the reference back end")


def render_cuda(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, pose: Tensor | None, settings: RasterSettings
) -> Rendered:
    """Renders one view; arguments and result as in `render`.

    Raises:
        DeviceError: CUDA or gsplat is missing, or the tensors or settings are not gsplat's.
    """
    gsplat = _gsplat()
    _check(gaussians, settings)
    means = gaussians.means
    if pose is None:
        pose = camera_pose(camera, means)
    if background is None:
        background = means.new_zeros(3)

    index, culled = visible(gaussians, camera, pose, settings)
    chosen = select(gaussians, index)
    screen = ScreenStatistics(torch.zeros(len(gaussians), device=means.device), culled)
    if index.numel() == 0:
        # gsplat does not take an empty list; an empty sum keeps the graph to the parameters.
        nothing = sum((tensor.sum() for _, tensor in chosen.named()), pose.sum() * 0)
        alpha = torch.zeros(camera.height, camera.width, device=means.device) + nothing
        image = background[:, None, None] * (1 - alpha)
        return Rendered(image, alpha, alpha.clone() if settings.depth else None, screen)

    bottom = means.new_tensor([[0.0, 0.0, 0.0, 1.0]])
    intrinsics = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
    planes, alpha, meta = gsplat.rasterization(
        means=chosen.means,
        quats=chosen.quaternions,
        scales=chosen.log_scales.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT).exp(),
        opacities=torch.sigmoid(chosen.opacity_logits),
        colors=chosen.sh,
        viewmats=torch.cat([pose, bottom])[None],
        Ks=means.new_tensor(intrinsics)[None],
        width=camera.width,
        height=camera.height,
        near_plane=settings.near,
        eps2d=settings.low_pass,
        sh_degree=gaussians.sh_degree,
        packed=False,
        tile_size=TILE,
        render_mode="RGB+D" if settings.depth else "RGB",
        rasterize_mode="antialiased" if settings.antialias else "classic",
    )  # planes: [1, H, W, 3 or 4], alpha: [1, H, W, 1]

    radii = meta["radii"][0].float()  # [M, 2] half sides, or [M] in gsplat before 1.5
    screen.radius[index] = radii.amax(dim=-1) if radii.ndim == 2 else radii
    projected = meta["means2d"]  # [1, M, 2]
    if projected.requires_grad:

        def keep_gradient(gradient: Tensor | None) -> None:
            if gradient is not None:
                everywhere = gradient.new_zeros(len(gaussians), 2)
                screen.mean_gradient = everywhere.index_copy(0, index, gradient[0])

        projected.register_hook(keep_gradient)

    alpha = alpha[0, :, :, 0]
    image = planes[0, :, :, :3].permute(2, 0, 1) + background[:, None, None] * (1 - alpha)
    return Rendered(image, alpha, planes[0, :, :, 3] if settings.depth else None, screen)
