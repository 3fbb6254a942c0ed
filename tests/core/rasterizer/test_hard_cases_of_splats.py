"""What breaks other engines: poison, needles, discs, giants, grazing views, opaque stacks, ties."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from dgs.core.constants import NEAR_PLANE
from dgs.core.devices import tensors_on
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, Rendered, render
from dgs.tests.core.rasterizer.rasterizer_scenes import (
    assert_same_image,
    gradients,
    joined,
    make_camera,
    random_scene,
    relative,
    single,
)
from torch import Tensor


def draw(scene: Gaussians, backend: str, **options: Any) -> Rendered:
    device = tensors_on(backend)
    return render(scene.to(device=device), make_camera(), backend=backend, **options)  # type: ignore[arg-type]


def assert_finite(view: Rendered, found: dict[str, Tensor]) -> None:
    assert bool(view.image.isfinite().all()) and bool(view.alpha.isfinite().all())
    for name, gradient in found.items():
        assert bool(gradient.isfinite().all()), name


@pytest.mark.parametrize("poison", [float("nan"), float("inf"), float("-inf"), 3e38, -3e38, 1e-44, 0.0])
def test_poison_in_every_slot(any_backend: str, poison: float) -> None:
    """One poisoned value: output and gradients finite, the other Gaussians untouched or blended with
    something finite; what is not finite is culled and counted."""
    clean = random_scene(12, 1, seed=1)
    camera, twist = make_camera(), torch.zeros(6)
    for name, tensor in clean.named():
        slots = tensor[0].numel()
        for slot in range(min(slots, 4)):
            scene = clean.detached()
            dict(scene.named())[name][0].view(-1)[slot] = poison
            if name == "quaternions" and poison == 0.0:
                scene.quaternions[0] = 0.0
            view, found = gradients(scene, camera, any_backend, twist=twist)
            if abs(poison) < 1e38 or name != "sh":  # colours of 3e38 overflow honestly
                assert_finite(view, found)
            if not torch.tensor(poison).isfinite():
                assert view.screen.culled["non_finite"] == 1, (name, slot)
                assert float(view.screen.radius[0]) == 0.0
                rest = Gaussians(**{n: t[1:] for n, t in clean.named()})
                assert_same_image(view.image, gradients(rest, camera, any_backend)[0].image, 1e-6)


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("needle", [3.0, 1e-12, 1e-12]),
        ("disc", [0.5, 0.5, 1e-12]),
        ("edge-on disc", [1e-12, 0.5, 0.5]),
        ("giant", [1e3, 1e3, 1e3]),
        ("needle of a thousand frames", [1e3, 1e-3, 1e-3]),
        ("dust", [1e-12, 1e-12, 1e-12]),
    ],
)
def test_extreme_shapes_equal_float64(any_backend: str, name: str, scale: list[float]) -> None:
    scene = single((0.05, 0.02, 3.0), scale, logit=1.0)
    scene.quaternions[:] = torch.tensor([0.9, 0.1, 0.3, 0.2])
    camera = make_camera()
    truth, wanted = gradients(scene.to(dtype=torch.float64), camera, "reference")
    view, found = gradients(scene, camera, any_backend)
    assert float(truth.alpha.max()) > 0.3, "the case must be seen"
    assert_finite(view, found)
    assert_same_image(view.alpha, truth.alpha, 2e-3)
    scale_of_all = max(float(g.norm()) for g in wanted.values())
    for parameter, gradient in wanted.items():
        error = float((found[parameter].double() - gradient).norm())
        assert error < 5e-3 * max(float(gradient.norm()), 0.02 * scale_of_all), (name, parameter)


@pytest.mark.parametrize("scale", [1e3, 1e6, 1e12])
def test_giants_still_cover_the_frame(any_backend: str, scale: float) -> None:
    """Huge but valid splats do not vanish: the whole frame takes their opacity."""
    view, found = gradients(single((0.0, 0.0, 3.0), scale, logit=0.0), make_camera(), any_backend)
    assert_finite(view, found)
    assert torch.allclose(view.alpha, torch.full_like(view.alpha, 0.5), atol=1e-3)


def test_sweep_through_the_camera_plane(any_backend: str) -> None:
    """At, behind and beside the camera, out to ten times the viewing direction."""
    for z in (-1.0, -1e-6, 0.0, 1e-30, NEAR_PLANE * 0.5, NEAR_PLANE * 1.5, 0.1, 1.0):
        for ratio in (0.0, 1.0, 10.0):
            # In the test camera's own axes, then brought to the world.
            camera = make_camera()
            point = torch.tensor([z * ratio, -z * ratio * 0.5, z], dtype=torch.float64)
            world = torch.from_numpy(camera.rotation).T @ (point - torch.from_numpy(camera.translation))
            scene = single((0.0, 0.0, 0.0), 0.05)
            scene.means[:] = world.float()
            view, found = gradients(scene, camera, any_backend, twist=torch.zeros(6))
            assert_finite(view, found)
            if z < NEAR_PLANE:
                assert view.screen.culled["behind"] == 1, z


def test_a_gaussian_at_the_camera_centre(any_backend: str) -> None:
    camera = make_camera()
    scene = single((0.0, 0.0, 0.0), 0.2)
    scene.means[:] = torch.from_numpy(camera.centre).float()
    view, found = gradients(joined(scene, random_scene(5, 0)), camera, any_backend, twist=torch.zeros(6))
    assert_finite(view, found)
    assert view.screen.culled["behind"] >= 1


@pytest.mark.parametrize("logit", [3.0, 12.0])
def test_stack_of_64_opaque_splats(any_backend: str, logit: float) -> None:
    """Transmittance runs out; float32 gradients must still be those of float64."""
    layers = [single((0.002 * i, 0.0, 2.0 + 0.05 * i), [0.4 + 0.01 * i, 0.3, 0.2], logit) for i in range(64)]
    scene = joined(*layers)
    random = torch.Generator().manual_seed(0)
    scene.sh += 0.3 * torch.randn(scene.sh.shape, generator=random)
    scene.quaternions += 0.3 * torch.randn(scene.quaternions.shape, generator=random)
    truth, wanted = gradients(scene.to(dtype=torch.float64), make_camera(), "reference")
    view, found = gradients(scene, make_camera(), any_backend)
    assert_same_image(view.image, truth.image, 1e-4)
    # In float32, torch computes 1 - sigmoid(12) = 6e-6 to 1 % only; the kernels compute it in double.
    saturated = logit > 10 and any_backend == "reference"
    for name, gradient in wanted.items():
        limit = 2e-2 if saturated and name == "opacity_logits" else 1e-3
        assert relative(found[name], gradient) < limit, name


def test_hdr_colours_stay_finite(any_backend: str) -> None:
    scene = random_scene(40, 2, seed=2)
    scene.sh *= 1e4
    truth, wanted = gradients(scene.to(dtype=torch.float64), make_camera(), "reference")
    view, found = gradients(scene, make_camera(), any_backend)
    assert_finite(view, found)
    assert float(view.image.max()) > 1e3, "the case must be bright"
    assert_same_image(view.image / 1e4, truth.image / 1e4, 2e-5)
    for name, gradient in wanted.items():
        assert relative(found[name], gradient) < 1e-3, name


def test_input_order_does_not_matter(any_backend: str) -> None:
    """Ties in depth (a wall that faces the camera) are broken by content."""
    scene = random_scene(200, 0, seed=3)
    camera = make_camera()
    forward = torch.from_numpy(camera.rotation[2]).float()
    scene.means -= (scene.means @ forward)[:, None] * forward  # same depth, to rounding
    scene.means += 3.0 * forward
    # Exact ties: copies of one place with other colours and opacities.
    scene.means[:40] = scene.means[0]
    first = draw(scene, any_backend).image
    for seed in range(3):
        order = torch.randperm(200, generator=torch.Generator().manual_seed(seed))
        shuffled = Gaussians(**{name: tensor[order] for name, tensor in scene.named()})
        image = draw(shuffled, any_backend).image
        if any_backend == "reference":  # torch rounds the ends of long vectors in another way
            assert float((image - first).abs().max()) < 1e-6
        else:
            assert torch.equal(image, first)


def test_a_wall_of_ties_takes_no_quadratic_time(any_backend: str) -> None:
    """20,000 Gaussians at one depth: sorting ties must not compare all pairs."""
    import time

    count = 20_000
    random = torch.Generator().manual_seed(0)
    scene = random_scene(count, 0, size=-6.0)
    camera = make_camera()
    scene.means[:] = torch.rand(count, 3, generator=random) * 2 - 1
    scene.means[:, 2] = 0.0
    straight = camera.moved(torch.eye(3).numpy().astype("float64"), torch.tensor([0.0, 0, 3]).numpy())
    device = tensors_on(any_backend)
    render(scene.to(device=device), straight, backend=any_backend)  # type: ignore[arg-type]
    start = time.thread_time()
    render(scene.to(device=device), straight, backend=any_backend)  # type: ignore[arg-type]
    assert time.thread_time() - start < 5.0


def test_large_world_coordinates_after_recentring(any_backend: str) -> None:
    """A twin in other units renders the same: scales by 1e-3 to 1e3 with near plane and camera."""
    scene, camera = random_scene(60, 0, seed=4), make_camera()
    base = draw(scene, any_backend).image.cpu()
    for unit in (1e-3, 1e3):
        other = scene.detached()
        other.means *= unit
        other.log_scales += torch.tensor(unit).log()
        device = tensors_on(any_backend)
        moved = camera.moved(camera.rotation, camera.translation * unit)
        view = render(
            other.to(device=device),
            moved,
            settings=RasterSettings(near=NEAR_PLANE * unit),
            backend=any_backend,  # type: ignore[arg-type]
        )
        assert_same_image(view.image.cpu(), base, 1e-4)
