"""Scenes and comparisons that the rasterizer's tests share."""

from __future__ import annotations

from dataclasses import replace

import torch
from dgs.core.camera import Camera
from dgs.core.devices import tensors_on
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import Rendered, render
from dgs.studies.stability import scenes
from torch import Tensor

make_camera, joined = scenes.make_camera, scenes.joined


def random_scene(
    count: int, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32, size: float = -2.3
) -> Gaussians:
    """As of the hard cases, in another precision."""
    return scenes.random_scene(count, degree, seed, size).to(dtype=dtype)


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

    device = tensors_on(backend)
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
