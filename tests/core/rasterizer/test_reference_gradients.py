"""Autograd of the reference against finite differences in float64: the ground all else stands on."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.rasterizer.projection import camera_pose
from dgs.core.rigid_motion import moved_pose
from dgs.tests.core.rasterizer.rasterizer_scenes import make_camera, random_scene
from torch import Tensor

SMOOTH = RasterSettings(alpha_minimum=0.0, depth=True)


def small_scene(degree: int, count: int = 4) -> Gaussians:
    """Few enough Gaussians, all in the frame, for finite differences."""
    scene = random_scene(count, degree, seed=degree, dtype=torch.float64, size=-1.5)
    scene.means[:, :2] *= 0.4
    return scene.requires_grad_()


def weighted(outputs: list[Tensor]) -> Tensor:
    """Two different weightings of all outputs: gradcheck costs one backward pass per number."""
    flat = torch.cat([output.flatten() for output in outputs])
    steps = torch.arange(flat.numel(), dtype=flat.dtype)
    return torch.stack([(flat * (1.7 * steps).sin()).sum(), (flat * (0.3 * steps).cos()).sum()])


@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_image_alpha_and_depth(degree: int, antialias: bool) -> None:
    """All five parameters, the background and the pose's twist, in every degree."""
    camera = make_camera(19, 13, 20.0)
    scene = small_scene(degree)
    background = torch.rand(3, dtype=torch.float64, requires_grad=True)
    twist = torch.full((6,), 0.02, dtype=torch.float64, requires_grad=True)
    settings = replace(SMOOTH, antialias=antialias)

    def outputs(*inputs: Tensor) -> Tensor:
        pose = moved_pose(inputs[6], camera_pose(camera, inputs[0]))
        view = render(
            Gaussians(*inputs[:5]), camera, background=inputs[5], pose=pose, settings=settings, backend="reference"
        )
        assert view.depth is not None
        return weighted([view.image, view.alpha, view.depth])

    inputs = (*(tensor for _, tensor in scene.named()), background, twist)
    # Fast mode checks one random direction per input; the small degrees are checked entry by entry.
    assert torch.autograd.gradcheck(outputs, inputs, fast_mode=degree > 1, check_undefined_grad=False)


def test_pose_entries() -> None:
    """The pose is differentiable entry by entry, off the rigid motions too."""
    camera = make_camera(19, 13, 20.0)
    scene = small_scene(1).detached()
    pose = camera_pose(camera, scene.means).requires_grad_()

    def outputs(pose: Tensor) -> Tensor:
        view = render(scene, camera, pose=pose, settings=SMOOTH, backend="reference")
        return weighted([view.image, view.alpha])

    assert torch.autograd.gradcheck(outputs, (pose,))


def test_clamped_directions_have_no_gradient_through_the_ratio() -> None:
    """Far beside the frame the Jacobian stands still, and finite differences agree."""
    camera = make_camera(16, 16, 20.0)
    scene = small_scene(0, 2).detached()
    scene.means[:] = torch.tensor([[3.0, 0.2, 2.0], [-0.3, -4.0, 2.0]])
    scene.log_scales[:] = 0.2
    scene.requires_grad_()

    def outputs(*inputs: Tensor) -> Tensor:
        view = render(Gaussians(*inputs), camera, settings=SMOOTH, backend="reference")
        return weighted([view.image, view.alpha])

    assert float(render(scene.detached(), camera, settings=SMOOTH).alpha.max()) > 0.01
    assert torch.autograd.gradcheck(outputs, tuple(t for _, t in scene.named()), check_undefined_grad=False)


def test_scales_beyond_the_limit_have_no_gradient() -> None:
    scene = small_scene(0, 3).detached()
    scene.log_scales[0, 2] = -50.0
    scene.requires_grad_()
    render(scene, make_camera(19, 13, 20.0), backend="reference").image.sum().backward()
    assert scene.log_scales.grad is not None
    assert float(scene.log_scales.grad[0, 2]) == 0.0
    assert float(scene.log_scales.grad[0, :2].abs().min()) > 0.0


def test_from_gaussians_to_loss_through_the_medium() -> None:
    """The whole chain that training differentiates: Gaussians -> image -> PSF -> loss."""
    from dgs.core.imaging.operator import BlurOperator
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.training.loss.photometric import photometric_reference

    height, width, margin = 14, 19, 3
    camera = make_camera(width, height, 20.0)
    blur = BlurOperator(PointSpread(sigma_x=1.4, sigma_y=0.9, angle=20.0), height, width, margin, dtype=torch.float64)
    photo = torch.rand(3, height, width, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    scene = small_scene(1)

    def loss(*inputs: Tensor) -> Tensor:
        view = render(Gaussians(*inputs), camera.with_margin(margin), settings=SMOOTH, backend="reference")
        seen = blur(view.image)
        # The absolute error has no kink here: a random photo and a smooth render do not touch.
        return photometric_reference(seen, photo)

    assert torch.autograd.gradcheck(loss, tuple(t for _, t in scene.named()), check_undefined_grad=False)
