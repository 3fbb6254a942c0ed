"""Scenes and comparisons that the cases of the rasterizer share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ...core.camera import Camera
from ...core.constants import SH_COEFFICIENTS
from ...core.devices import BackendName, tensors_on
from ...core.gaussians import Gaussians
from ...core.rasterizer import RasterSettings, Rendered, render
from ...core.rasterizer.projection import camera_pose
from ...core.rigid_motion import moved_pose
from .case import Site

#: Share of the largest gradient below which a parameter's own gradient is too small to be compared by itself.
NEGLIGIBLE = 0.02


def make_camera(width: int = 61, height: int = 45, focal: float = 60.0) -> Camera:
    """A camera that looks along z, a little turned, with an off-centre lens."""
    angle = 0.1
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return Camera(
        "case.png",
        width,
        height,
        focal,
        focal * 1.03,
        width / 2 + 0.7,
        height / 2 - 0.4,
        rotation,
        np.array([0.05, -0.1, 0.2]),
    )


def random_scene(count: int, degree: int = 1, seed: int = 0, size: float = -2.3) -> Gaussians:
    """`count` Gaussians before the camera, opacities below the cap, some of them outside the frame."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=random)

    means = normal(count, 3) * torch.tensor([1.1, 0.8, 0.7]) + torch.tensor([0.0, 0.0, 3.5])
    sh = normal(count, SH_COEFFICIENTS[degree], 3) * 0.3
    return Gaussians(means, normal(count, 3) * 0.5 + size, normal(count, 4), (normal(count) * 1.5).clamp(max=3.0), sh)


def single(
    position: tuple[float, float, float],
    scale: float | list[float],
    logit: float = 2.0,
    turn: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
) -> Gaussians:
    """One grey Gaussian."""
    scales = torch.tensor([scale] * 3 if isinstance(scale, float) else scale, dtype=torch.float64)
    return Gaussians(
        torch.tensor([position]),
        scales.log().float()[None],
        torch.tensor([turn]),
        torch.tensor([logit]),
        torch.full((1, 1, 3), 0.8),
    )


def joined(*parts: Gaussians) -> Gaussians:
    """Several sets of Gaussians as one."""
    return Gaussians(**{name: torch.cat([getattr(p, name) for p in parts]) for name, _ in parts[0].named()})


def rows(gaussians: Gaussians, index: Tensor) -> Gaussians:
    """Some of the Gaussians, in the order of `index`."""
    return Gaussians(**{name: tensor[index] for name, tensor in gaussians.named()})


@dataclass
class Drawn:
    """A view and the gradients of a fixed random weighting of all it shows, in the CPU's memory.

    Attributes:
        image [3, H, W], alpha [H, W]: of the view.
        gradients: by parameter name, and 'twist' for the pose.
        view: the whole answer.
    """

    image: Tensor
    alpha: Tensor
    gradients: dict[str, Tensor]
    view: Rendered = field(repr=False)

    @property
    def finite(self) -> bool:
        """Whether everything is finite."""
        parts = [self.image, self.alpha, *self.gradients.values()]
        parts += [] if self.view.depth is None else [self.view.depth]
        return all(bool(part.isfinite().all()) for part in parts)


def drawn(
    gaussians: Gaussians,
    camera: Camera,
    backend: BackendName,
    settings: RasterSettings = RasterSettings(),
    background: Tensor | None = None,
    seed: int = 5,
) -> Drawn:
    """Renders on a back end (the Gaussians are moved to it) and differentiates."""
    device = tensors_on(backend)
    leaves = gaussians.detached().to(device=device).requires_grad_()
    twist = torch.zeros(6, dtype=leaves.means.dtype, device=device, requires_grad=True)
    pose = moved_pose(twist, camera_pose(camera, leaves.means))
    behind = None if background is None else background.to(leaves.means)
    view = render(leaves, camera, background=behind, pose=pose, settings=settings, backend=backend)
    random = torch.Generator().manual_seed(seed)
    loss = torch.zeros((), dtype=leaves.means.dtype, device=device)
    for output in (view.image, view.alpha, view.depth):
        if output is not None:
            loss = loss + (output * torch.randn(output.shape, generator=random).to(output)).sum()
    inputs = {**dict(leaves.named()), "twist": twist}
    found = torch.autograd.grad(loss, list(inputs.values()), allow_unused=True)
    gradients = {
        name: (torch.zeros_like(value) if gradient is None else gradient).cpu()
        for (name, value), gradient in zip(inputs.items(), found, strict=True)
    }
    return Drawn(view.image.detach().cpu(), view.alpha.detach().cpu(), gradients, view)


def against_float64(
    gaussians: Gaussians, camera: Camera, site: Site, settings: RasterSettings = RasterSettings()
) -> tuple[float, float]:
    """(worst pixel, worst gradient) of float32 on a back end against float64 on the reference.

    Gradients are compared tensor by tensor: distance over the norm of the true one, or over
    `NEGLIGIBLE` times the largest tensor's, if that is more.
    """
    truth = drawn(gaussians.to(dtype=torch.float64), camera, "reference", settings)
    found = drawn(gaussians, camera, site.backend, settings)
    if not found.finite:
        return math.inf, math.inf
    pixel = max(pixels_apart(found.image, truth.image), pixels_apart(found.alpha, truth.alpha))
    names = [name for name in truth.gradients if name != "twist"]
    largest = max(float(truth.gradients[name].norm()) for name in names)
    apart = []
    for name in names:
        wanted = truth.gradients[name]
        floor = max(float(wanted.norm()), NEGLIGIBLE * largest, 1e-6)
        apart.append(float((found.gradients[name].double() - wanted).norm()) / floor)
    return pixel, max(apart)


def pixels_apart(found: Tensor, truth: Tensor) -> float:
    """Largest difference of two images but for 1 value in 10,000, where rounding may put an evaluation on the other
    side of the alpha cutoff or of the transmittance stop; those count by how much they exceed two 8-bit steps."""
    error = (found.double() - truth.double()).abs().flatten()
    if not bool(error.isfinite().all()):
        return math.inf
    if not len(error):
        return 0.0
    ordered = error.sort().values
    bulk = float(ordered[len(ordered) - 1 - len(ordered) // 10_000])
    return bulk if float(ordered[-1]) <= 2 / 255 else float(ordered[-1])
