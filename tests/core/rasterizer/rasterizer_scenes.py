"""Scenes and comparisons that the rasterizer's tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.constants import SH_COEFFICIENTS
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import Rendered, render
from torch import Tensor


def make_camera(width: int = 61, height: int = 45, focal: float = 60.0) -> Camera:
    """A camera that looks along z, a little turned, with an off-centre lens."""
    angle = 0.1
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return Camera(
        "test.png",
        width,
        height,
        focal,
        focal * 1.03,
        width / 2 + 0.7,
        height / 2 - 0.4,
        rotation,
        np.array([0.05, -0.1, 0.2]),
    )


def random_scene(
    count: int, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32, size: float = -2.3
) -> Gaussians:
    """`count` Gaussians before the camera, opacities below the cap, some of them outside the frame."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=random)

    means = normal(count, 3) * torch.tensor([1.1, 0.8, 0.7]) + torch.tensor([0.0, 0.0, 3.5])
    sh = normal(count, SH_COEFFICIENTS[degree], 3) * 0.3
    scene = Gaussians(means, normal(count, 3) * 0.5 + size, normal(count, 4), (normal(count) * 1.5).clamp(max=3.0), sh)
    return scene.to(dtype=dtype)


def single(position: tuple[float, float, float], scale: float | list[float], logit: float = 2.0) -> Gaussians:
    """One grey Gaussian, for edge cases."""
    scales = torch.tensor([scale] * 3 if isinstance(scale, float) else scale)
    return Gaussians(
        torch.tensor([position]),
        scales.log()[None],
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.tensor([logit]),
        torch.full((1, 1, 3), 0.8),
    )


def joined(*parts: Gaussians) -> Gaussians:
    """Several sets of Gaussians as one."""
    return Gaussians(**{name: torch.cat([getattr(p, name) for p in parts]) for name, _ in parts[0].named()})


def gradients(
    gaussians: Gaussians,
    camera: Camera,
    backend: str,
    *,
    background: Tensor | None = None,
    twist: Tensor | None = None,
    seed: int = 5,
    **options: object,
) -> tuple[Rendered, dict[str, Tensor]]:
    """Renders and differentiates a fixed random weighting of all outputs.

    Returns the view (on the CPU's memory) and the gradients of all parameters and of what else was
    given: 'background', 'twist'.
    """
    from dgs.core.rasterizer.projection import camera_pose
    from dgs.core.rigid_motion import moved_pose

    device = "cuda" if backend == "cuda" else "cpu"
    leaves = gaussians.detached().to(device=device).requires_grad_()
    inputs = dict(leaves.named())
    pose = None
    if background is not None:
        inputs["background"] = background = background.to(leaves.means).requires_grad_()
    if twist is not None:
        inputs["twist"] = twist = twist.to(leaves.means).requires_grad_()
        pose = moved_pose(twist, camera_pose(camera, leaves.means))
    view = render(leaves, camera, background=background, pose=pose, backend=backend, **options)  # type: ignore[arg-type]
    random = torch.Generator().manual_seed(seed)
    loss = torch.zeros((), dtype=leaves.means.dtype, device=device)
    for output in (view.image, view.alpha, view.depth):
        if output is not None:
            loss = loss + (output * torch.randn(output.shape, generator=random).to(output)).sum()
    found = torch.autograd.grad(loss, list(inputs.values()), allow_unused=True)
    zeros = [torch.zeros_like(tensor) for tensor in inputs.values()]
    named = {
        name: (zero if gradient is None else gradient).cpu()
        for name, gradient, zero in zip(inputs, found, zeros, strict=True)
    }
    screen = replace(view.screen, radius=view.screen.radius.cpu())
    if screen.mean_gradient is not None:
        screen.mean_gradient = screen.mean_gradient.cpu()
    depth = None if view.depth is None else view.depth.detach().cpu()
    return Rendered(view.image.detach().cpu(), view.alpha.detach().cpu(), depth, screen), named


def relative(found: Tensor, truth: Tensor) -> float:
    """Distance of two tensors as a share of the second one's norm (or of 1e-6, if that is larger)."""
    return float((found.double() - truth.double()).norm() / truth.double().norm().clamp(min=1e-6))


def assert_same_image(found: Tensor, truth: Tensor, tolerance: float) -> None:
    """All but 1 in 10,000 values within `tolerance`, and those within two 8-bit steps.

    Rounding may put an evaluation on the other side of the alpha cutoff (1/255) or of the
    transmittance stop.
    """
    error = (found.double() - truth.double()).abs()
    assert bool(error.isfinite().all())
    if error.numel():
        assert float((error > tolerance).double().mean()) <= 1e-4, f"largest error {float(error.max()):.2e}"
        assert float(error.max()) <= 2 / 255
