"""The fast back ends against the reference in float64: values, gradients and statistics."""

from __future__ import annotations

import pytest
import torch
from dgs.core.devices import tensors_on
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render
from dgs.tests.core.rasterizer.rasterizer_scenes import (
    assert_same_image,
    gradients,
    joined,
    make_camera,
    random_scene,
    relative,
    single,
)

DEFAULTS = RasterSettings()
#: Of colours around 1 in float32.
VALUES = 2e-5
#: Share of a gradient tensor's norm.
GRADIENTS = 1e-3


def check_agreement(
    scene: Gaussians, backend: str, width: int = 61, height: int = 45, settings: RasterSettings = DEFAULTS
) -> None:
    """Same image, alpha, depth, gradients of everything, and screen statistics."""
    camera = make_camera(width, height)
    inputs = {"background": torch.tensor([0.2, 0.7, 0.4]), "twist": torch.full((6,), 0.01)}
    truth, wanted = gradients(
        scene.to(dtype=torch.float64),
        camera,
        "reference",
        settings=settings,
        **{name: value.double() for name, value in inputs.items()},
    )
    found, got = gradients(scene, camera, backend, settings=settings, **inputs)
    assert_same_image(found.image, truth.image, VALUES)
    assert_same_image(found.alpha, truth.alpha, VALUES)
    if settings.depth:
        assert found.depth is not None and truth.depth is not None
        farthest = float(scene.means[:, 2].max()) if len(scene) else 1.0
        assert_same_image(found.depth / farthest, truth.depth / farthest, VALUES)
    for name, gradient in wanted.items():
        assert got[name].shape == gradient.shape
        assert relative(got[name], gradient) < GRADIENTS, name

    for reason in ("non_finite", "behind", "degenerate", "transparent"):
        assert found.screen.culled.get(reason, 0) == truth.screen.culled.get(reason, 0), reason
    # The reference tests the box of the ellipse, the others may test the ellipse itself: they may
    # see less, but nothing more, and only what has no gradient.
    seen, sighted = found.screen.radius > 0, truth.screen.radius > 0
    assert not bool((seen & ~sighted).any())
    assert float(wanted["sh"][sighted & ~seen].abs().sum()) == 0.0
    assert relative(found.screen.radius[seen], truth.screen.radius[seen]) < 1e-4
    if truth.screen.mean_gradient is not None and len(scene):
        assert found.screen.mean_gradient is not None
        assert relative(found.screen.mean_gradient, truth.screen.mean_gradient) < GRADIENTS


@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_degree_and_filter(backend: str, degree: int, antialias: bool) -> None:
    settings = RasterSettings(antialias=antialias, depth=True)
    check_agreement(random_scene(150, degree, seed=degree), backend, settings=settings)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 40), (16, 16), (17, 15), (32, 16), (33, 50), (100, 7)])
def test_sizes_that_are_no_multiple_of_the_tile(backend: str, width: int, height: int) -> None:
    check_agreement(random_scene(80, seed=3), backend, width, height, RasterSettings(depth=True))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_gaussians(backend: str, count: int) -> None:
    check_agreement(random_scene(count, seed=4), backend, settings=RasterSettings(depth=True))


@pytest.mark.parametrize("low_pass", [0.0, 0.05, 2.0])
def test_low_pass(backend: str, low_pass: float) -> None:
    check_agreement(random_scene(100, seed=5), backend, settings=RasterSettings(low_pass=low_pass))


def test_dense_and_faint(backend: str) -> None:
    """Many thin layers: every pixel sums hundreds of evaluations."""
    scene = random_scene(1500, seed=6, size=-1.6)
    scene.opacity_logits -= 3.0
    check_agreement(scene, backend, settings=RasterSettings(depth=True))


def test_opaque_scene_stops_early(backend: str) -> None:
    scene = random_scene(1500, seed=7, size=-1.6)
    scene.opacity_logits.clamp_(min=1.0)
    check_agreement(scene, backend, settings=RasterSettings(depth=True))


def test_many_small_gaussians(backend: str) -> None:
    """Footprints of about a pixel, below and above the alpha cutoff."""
    check_agreement(random_scene(3000, seed=8, size=-4.2), backend, 128, 96)


def test_without_alpha_cutoff(backend: str) -> None:
    check_agreement(random_scene(60, seed=9), backend, settings=RasterSettings(alpha_minimum=0.0, depth=True))


def test_outputs_alone_have_their_own_gradients(backend: str) -> None:
    """Depth and alpha each alone: no gradient leaks from one output into another."""
    camera, settings = make_camera(), RasterSettings(depth=True)
    for output in ("image", "alpha", "depth"):
        found = {}
        for name in ("reference", backend):
            scene = random_scene(60, seed=10).to(device=tensors_on(name)).requires_grad_()
            view = render(scene, camera, settings=settings, backend=name)  # type: ignore[arg-type]
            plane = getattr(view, output)
            weights = torch.randn(plane.shape, generator=torch.Generator().manual_seed(1)).to(plane)
            (plane * weights).sum().backward()
            found[name] = {n: (t.new_zeros(t.shape) if t.grad is None else t.grad).cpu() for n, t in scene.named()}
        for parameter, gradient in found["reference"].items():
            assert relative(found[backend][parameter], gradient) < GRADIENTS, (output, parameter)


def test_backward_from_a_view_that_sees_nothing(backend: str) -> None:
    """All culled: the background, and zero gradients rather than none."""
    scene = single((0.0, 0.0, -3.0), 0.1)
    view, found = gradients(scene, make_camera(), backend, background=torch.tensor([0.1, 0.2, 0.3]))
    assert torch.equal(view.image[:, 0, 0], torch.tensor([0.1, 0.2, 0.3]))
    assert float(view.alpha.abs().max()) == 0.0
    assert view.screen.culled["behind"] == 1
    for name, gradient in found.items():
        if name != "background":
            assert float(gradient.abs().max()) == 0.0, name


def test_statistics_name_every_reason(backend: str) -> None:
    unseen = single((0.0, 0.0, 3.0), 0.1)
    unseen.quaternions[:] = 0.0
    poisoned = single((0.0, 0.0, 3.0), 0.1)
    poisoned.sh[0, 0, 1] = float("nan")
    scene = joined(
        single((0.0, 0.0, 3.0), 0.1),
        single((0.0, 0.0, -3.0), 0.1),
        single((9.0, 0.0, 3.0), 0.1),
        single((0.0, 0.0, 3.0), 0.1, logit=-7.0),
        unseen,
        poisoned,
    )
    device = tensors_on(backend)
    view = render(scene.to(device=device), make_camera(), backend=backend)  # type: ignore[arg-type]
    counted = {reason: count for reason, count in view.screen.culled.items() if count}
    assert counted == {"behind": 1, "outside": 1, "transparent": 1, "degenerate": 1, "non_finite": 1}
    assert (view.screen.radius > 0).tolist() == [True, False, False, False, False, False]
