"""The rasterizer's door: what every back end takes and gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import ALPHA_MINIMUM, LOW_PASS_VARIANCE, NEAR_PLANE
from ..errors import DeviceError
from ..gaussians import Gaussians

Backend = Literal["auto", "reference", "cpu", "cuda"]
#: Opacity from which on a pixel has a depth worth dividing by.
OPAQUE_ENOUGH = 0.05
BACKENDS: tuple[Backend, ...] = ("reference", "cpu", "cuda")


@dataclass(frozen=True)
class RasterSettings:
    """Choices of the image formation that all back ends share.

    Attributes:
        low_pass: variance (px^2) added to the projected covariance.
        antialias: scale the opacity by sqrt(det(cov) / det(cov + low_pass)), so that a splat
            thinner than the low-pass keeps its light (Mip-Splatting's 2D filter).
        alpha_minimum: evaluations below it are skipped; 0 makes the image smooth in its
            parameters (for gradient checks), at the price of speed.
        near: Gaussians nearer than this (world units) are culled.
        depth: also blend the depth of the centres (in world units, not divided by alpha).
    """

    low_pass: float = LOW_PASS_VARIANCE
    antialias: bool = False
    alpha_minimum: float = ALPHA_MINIMUM
    near: float = NEAR_PLANE
    depth: bool = False


@dataclass
class ScreenStatistics:
    """What one view says about each Gaussian; density control and reports read it.

    Attributes:
        radius: [N] float32, half-extent of the visible ellipse in px; 0 where culled.
        culled: counts by reason ('non_finite', 'behind', 'transparent', 'outside',
            'degenerate'), so that nothing is dropped silently.
        evaluations: number of Gaussian-pixel pairs evaluated (0 if the back end does not count).
        mean_gradient: [N, 2] gradient of the loss w.r.t. the projected centres in px,
            filled by the backward pass; None before it.
    """

    radius: Tensor
    culled: dict[str, int] = field(default_factory=dict)
    evaluations: int = 0
    mean_gradient: Tensor | None = None


@dataclass
class Rendered:
    """One rendered view.

    Attributes:
        image: [3, H, W] colours over the background, in the space the harmonics are in (sRGB).
        alpha: [H, W] opacity, 1 - transmittance.
        depth: [H, W] alpha-weighted depth of the centres, or None if not asked for.
        screen: per-Gaussian statistics.
    """

    image: Tensor
    alpha: Tensor
    depth: Tensor | None
    screen: ScreenStatistics

    @property
    def mean_depth(self) -> Tensor | None:
        """[H, W] mean depth of what is seen, without gradient; the frame's median where next to nothing is."""
        if self.depth is None:
            return None
        alpha, depth = self.alpha.detach(), self.depth.detach()
        mean = depth / alpha.clamp(min=OPAQUE_ENOUGH)
        seen = alpha > OPAQUE_ENOUGH
        return mean.where(seen, mean[seen].median() if bool(seen.any()) else mean.new_ones(()))


def render(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Tensor | None = None,
    pose: Tensor | None = None,
    settings: RasterSettings = RasterSettings(),
    backend: Backend = "auto",
) -> Rendered:
    """Projects, sorts and blends all Gaussians into one view (Kerbl et al. 2023; Zwicker's EWA).

    Args:
        gaussians: raw parameters; float32 (float64 on the reference back end too).
        camera: size and lens, and the pose unless `pose` is given.
        background: [3] colour behind everything; black if None.
        pose: [3, 4] world to camera, differentiable; the camera's own if None.
        settings: see `RasterSettings`.
        backend: 'auto' takes 'cuda' for tensors on a CUDA device, else 'cpu'
            ('reference' for float64).

    Returns:
        The view; gradients flow to all five parameters, the background and the pose.

    Raises:
        DeviceError: the back end does not fit the tensors or is not installed.
    """
    if backend == "auto":
        if gaussians.means.is_cuda:
            backend = "cuda"
        else:
            backend = "cpu" if gaussians.means.dtype == torch.float32 else "reference"
    if backend == "reference":
        from .reference import render_reference

        return render_reference(gaussians, camera, background, pose, settings)
    if backend == "cpu":
        from .cpu import render_cpu

        return render_cpu(gaussians, camera, background, pose, settings)
    if backend == "cuda":
        from .cuda import render_cuda

        return render_cuda(gaussians, camera, background, pose, settings)
    raise DeviceError(f"There is no rasterizer back end '{backend}'", f"Choose one of {', '.join(BACKENDS)}")
