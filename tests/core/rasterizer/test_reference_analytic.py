"""The reference against closed forms that need no renderer."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.constants import LOW_PASS_VARIANCE
from dgs.core.devices import tensors_on
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.rasterizer.harmonics import basis
from dgs.tests.core.rasterizer.rasterizer_scenes import joined, random_scene, relative, single
from torch import Tensor


def axis_camera(size: int = 33) -> Camera:
    return Camera("axis.png", size, size, 50.0, 50.0, size / 2, size / 2, np.eye(3), np.zeros(3))


def gaussian_spot(size: int, variance: float, opacity: float) -> Tensor:
    steps = torch.arange(size, dtype=torch.float64) + 0.5 - size / 2
    squares = steps[:, None].square() + steps[None, :].square()
    alpha = opacity * torch.exp(-0.5 * squares / variance)
    return torch.where(alpha >= 1 / 255, alpha, torch.zeros_like(alpha))


@pytest.mark.parametrize("antialias", [False, True])
def test_isotropic_gaussian_on_the_axis(any_backend: str, antialias: bool) -> None:
    """alpha = o exp(-r^2 / 2 (f s / z)^2 + low-pass); colour and depth follow."""
    device = tensors_on(any_backend)
    scene = single((0.0, 0.0, 2.0), 0.06, logit=1.0).to(device=device)
    camera = axis_camera()
    settings = RasterSettings(antialias=antialias, depth=True)
    background = torch.tensor([0.1, 0.2, 0.3], device=device)
    view = render(scene, camera, background=background, settings=settings, backend=any_backend)  # type: ignore[arg-type]

    variance = (50.0 * 0.06 / 2.0) ** 2
    opacity = 1 / (1 + math.exp(-1.0))
    if antialias:
        opacity *= variance / (variance + LOW_PASS_VARIANCE)
    alpha = gaussian_spot(33, variance + LOW_PASS_VARIANCE, opacity)
    colour = 0.8 * 0.28209479177387814 + 0.5
    expected = alpha * colour + (1 - alpha) * background.cpu().double()[:, None, None]
    assert view.depth is not None
    assert torch.allclose(view.alpha.cpu().double(), alpha, atol=2e-6)
    assert torch.allclose(view.image.cpu().double(), expected, atol=2e-6)
    assert torch.allclose(view.depth.cpu().double(), 2.0 * alpha, atol=4e-6)
    radius = math.sqrt(2 * math.log(opacity * 255) * (variance + LOW_PASS_VARIANCE))
    assert float(view.screen.radius[0]) == pytest.approx(radius, rel=1e-4)


def test_two_layers_blend_front_to_back(any_backend: str) -> None:
    near, far = single((0.0, 0.0, 2.0), 0.3, logit=0.0), single((0.0, 0.0, 4.0), 0.6, logit=1.0)
    near.sh[:] = torch.tensor([2.0, 0.0, -3.0])  # blue is clamped to black
    device = tensors_on(any_backend)
    scene = joined(far, near).to(device=device)
    view = render(scene, axis_camera(), backend=any_backend)  # type: ignore[arg-type]
    c0 = 0.28209479177387814
    front, back = torch.tensor([0.5 + 2 * c0, 0.5, 0.0]), torch.full((3,), 0.5 + 0.8 * c0)
    opacity = 1 / (1 + math.exp(-1.0))
    expected = 0.5 * front + 0.5 * opacity * back
    assert torch.allclose(view.image[:, 16, 16].cpu(), expected, atol=1e-5)
    assert float(view.alpha[16, 16]) == pytest.approx(1 - 0.5 * (1 - opacity), abs=1e-5)


def test_projected_ellipse_is_upright_and_flattened() -> None:
    """A Gaussian three times as wide (world x) as high gives that image, not its transpose."""
    view = render(single((0.0, 0.0, 2.0), [0.18, 0.06, 0.06]), axis_camera(), backend="reference")
    weights = view.alpha.double()
    steps = torch.arange(33, dtype=torch.float64) - 16
    spread_x = (weights * steps[None, :].square()).sum() / weights.sum()
    spread_y = (weights * steps[:, None].square()).sum() / weights.sum()
    assert float(spread_x) > 4 * float(spread_y)


def test_quaternion_turns_from_x_to_y() -> None:
    """w x y z: a quarter turn about the viewing axis exchanges width and height."""
    flat, turned = single((0.0, 0.0, 2.0), [0.18, 0.06, 0.06]), single((0.0, 0.0, 2.0), [0.18, 0.06, 0.06])
    turned.quaternions[:] = torch.tensor([2.0, 0.0, 0.0, 2.0])
    images = [render(scene, axis_camera(), backend="reference").alpha for scene in (flat, turned)]
    assert torch.allclose(images[0].T, images[1], atol=1e-5)


def test_harmonics_are_orthonormal() -> None:
    """Over the sphere (Fibonacci points), and in the order and signs of 3DGS files for degree 1."""
    count = 20_000
    steps = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * steps / count
    angle = steps * math.pi * (3 - math.sqrt(5))
    directions = torch.stack([angle.cos() * (1 - z * z).sqrt(), angle.sin() * (1 - z * z).sqrt(), z], dim=1)
    values = basis(directions, 16)
    gram = values.T @ values * (4 * math.pi / count)
    assert torch.allclose(gram, torch.eye(16, dtype=torch.float64), atol=1e-4)
    x, y, z = basis(torch.eye(3, dtype=torch.float64), 4)
    assert float(x[3]) < 0 and float(y[1]) < 0 and float(z[2]) > 0


def test_screen_gradient_is_that_of_a_shift() -> None:
    """Moving the principal point by a pixel moves every centre by one: the gradients must agree."""
    scene = random_scene(30, dtype=torch.float64)
    settings = RasterSettings(alpha_minimum=0.0)
    camera = axis_camera(41)

    def loss(shift: float) -> Tensor:
        moved = Camera("m.png", 41, 41, 50.0, 50.0, 20.5 + shift, 20.5, camera.rotation, camera.translation)
        view = render(scene, moved, settings=settings, backend="reference")
        weights = torch.linspace(0, 40, view.image.numel(), dtype=torch.float64).sin()
        loss.view = view  # type: ignore[attr-defined]
        return (view.image.flatten() * weights).sum()

    # The Jacobian is also taken at a direction that depends on cx only where it is clamped; the
    # Gaussians are kept inside the frame so that it is not.
    scene.means[:, :2] *= 0.3
    scene.requires_grad_()
    loss(0.0).backward()
    found = loss.view.screen.mean_gradient  # type: ignore[attr-defined]
    assert found is not None and found.shape == (30, 2)
    difference = (loss(1e-5) - loss(-1e-5)) / 2e-5
    assert relative(found[:, 0].sum(), difference.detach()) < 1e-6
