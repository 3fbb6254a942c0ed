"""A view in layers by distance: they add up to the view, go on behind what hides them, and both back ends agree."""

from dataclasses import replace

import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.devices import tensors_on
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, RenderedLayers, render, render_layers
from dgs.tests.core.rasterizer.rasterizer_scenes import make_camera, random_scene
from torch import Tensor

SMOOTH = RasterSettings(low_pass=0.3, alpha_minimum=0.0, depth=True)
#: Camera units from one layer to the next.
APART = 0.5


def places(twin: Gaussians, camera: Camera) -> Tensor:
    """Along four layers, nearer ones larger."""
    depth = twin.means @ torch.from_numpy(camera.rotation[2]).to(twin.means) + float(camera.translation[2])
    return ((depth.detach().max() - depth) / APART).clamp(0.0, 4.0)


def over(layers: RenderedLayers) -> Tensor:
    """[3, H, W] the layers blended in front of each other; exact where nothing lies in two of them."""
    image = torch.zeros_like(layers.planes[0, :3])
    for plane in layers.planes:
        image = plane[:3] + (1 - plane[3]) * image
    return image


def weighed(layers: RenderedLayers) -> Tensor:
    """A number that all that is rendered has a part in, each px by a weight of its own."""
    random = torch.Generator().manual_seed(3)
    parts = (layers.planes, layers.view.image, layers.view.alpha)
    return sum((part * torch.rand(part.shape, generator=random).to(part)).sum() for part in parts)  # type: ignore[return-value]


def test_one_layer_holds_the_whole_view() -> None:
    twin, camera, behind = random_scene(200), make_camera(70, 50), torch.tensor([0.2, 0.5, 0.7])
    layers = render_layers(twin, camera, torch.full((200,), 2.0), background=behind, settings=SMOOTH)
    expected = render(twin, camera, background=behind, settings=SMOOTH)
    assert layers.numbers == (2,)
    torch.testing.assert_close(layers.planes[0, :3], expected.image)
    torch.testing.assert_close(layers.planes[0, 3], torch.ones(50, 70))
    torch.testing.assert_close(layers.view.image, expected.image)
    torch.testing.assert_close(layers.view.depth, expected.depth)


def test_layers_far_apart_are_each_whole_and_blend_to_the_view(any_backend: str) -> None:
    """Every other layer is empty, so that each hides all of the next one, and shows what that one hides."""
    twin, camera, behind = random_scene(200), make_camera(70, 50), torch.tensor([0.2, 0.5, 0.7])
    place = places(twin, camera).round() * 2
    device = tensors_on(any_backend)  # type: ignore[arg-type]
    there = twin.to(device=device), camera, place.to(device)
    layers = render_layers(*there, background=behind.to(device), settings=SMOOTH, backend=any_backend)  # type: ignore[arg-type]
    layers = replace(layers, planes=layers.planes.detach().cpu())
    assert set(layers.numbers) == set(place.int().tolist())
    torch.testing.assert_close(over(layers), render(twin, camera, background=behind, settings=SMOOTH).image)
    for number, plane in zip(layers.numbers[1:], layers.planes[1:], strict=True):
        alone = twin.detached()
        alone.opacity_logits[place != number] = -30.0
        found = render(alone, camera, settings=SMOOTH)
        torch.testing.assert_close(plane[:3], found.image)
        torch.testing.assert_close(plane[3], found.alpha)


def test_what_lies_between_two_layers_is_in_both_by_its_share() -> None:
    twin, camera = random_scene(60), make_camera(70, 50)
    layers = render_layers(twin, camera, torch.full((60,), 1.25), settings=SMOOTH)
    expected = render(twin, camera, settings=SMOOTH)
    assert layers.numbers == (1, 2)
    torch.testing.assert_close(layers.planes[1, 3], 0.25 * expected.alpha)
    torch.testing.assert_close(layers.planes[0, 3], 0.75 * expected.alpha + (1 - expected.alpha))
    torch.testing.assert_close(layers.planes[:, :3].sum(dim=0), expected.image)


def test_a_neighbour_hides_and_what_is_nearer_does_not() -> None:
    twin, camera = random_scene(2, size=-1.0), make_camera(70, 50)
    place, towards = torch.from_numpy(camera.centre).float(), torch.from_numpy(camera.rotation[2]).float()
    twin.means[:] = place + torch.tensor([[2.0], [3.0]]) * towards  # one right before the other
    twin.opacity_logits[:] = 3.0
    shown = {}
    for near in (1.0, 1.9, 2.0):
        layers = render_layers(twin, camera, torch.tensor([near, 0.0]), settings=SMOOTH)
        shown[near] = float(layers.planes[0, :3].sum())
    assert shown[1.0] == pytest.approx(shown[1.9]), "as far as it hides at all, it hides whole"
    assert shown[1.0] < 0.6 * shown[2.0]


def test_back_ends_agree_on_layers_and_their_gradients(backend: str) -> None:
    camera, behind = make_camera(70, 50), torch.tensor([0.2, 0.5, 0.7])
    found = []
    for name, dtype in ((backend, torch.float32), ("reference", torch.float64)):
        device = tensors_on(name)  # type: ignore[arg-type]
        twin = random_scene(300, dtype=dtype).detached()
        place = places(twin, camera).to(device=device).requires_grad_()
        twin, colour = twin.to(device=device).requires_grad_(), behind.to(device, dtype, copy=True).requires_grad_()
        layers = render_layers(twin, camera, place, background=colour, settings=SMOOTH, backend=name)  # type: ignore[arg-type]
        weighed(layers).backward()
        screen = layers.view.screen.mean_gradient
        assert screen is not None
        leaves = {**dict(twin.named()), "place": place, "background": colour}
        gradients = {leaf: tensor.grad for leaf, tensor in leaves.items()} | {"screen": screen}
        found.append((layers, {leaf: part.cpu().double() for leaf, part in gradients.items() if part is not None}))
    (own, gradients), (expected, wanted) = found
    assert own.numbers == expected.numbers == (0, 1, 2, 3, 4) and set(gradients) == set(wanted)
    for one, other in ((own.planes, expected.planes), (own.view.alpha, expected.view.alpha)):
        torch.testing.assert_close(one.detach().cpu().double(), other.detach(), atol=2e-5, rtol=1e-4)
    for leaf, gradient in wanted.items():
        scale = float(gradient.abs().max())
        torch.testing.assert_close(gradients[leaf], gradient, atol=1e-3 * scale, rtol=1e-3, msg=leaf)


def test_gradients_of_the_reference_are_those_of_differences() -> None:
    twin, camera = random_scene(3, degree=0, dtype=torch.float64, size=-1.0), make_camera(8, 6)
    place = torch.tensor([0.3, 1.4, 2.7], dtype=torch.float64)
    leaves = [tensor.requires_grad_() for _, tensor in twin.named()] + [place.requires_grad_()]

    def planes(*parts: Tensor) -> Tensor:
        shown = render_layers(Gaussians(*parts[:5]), camera, parts[5], settings=SMOOTH, backend="reference")
        return shown.planes[..., ::2, ::3]

    assert torch.autograd.gradcheck(planes, leaves, eps=1e-6, atol=1e-5, nondet_tol=1e-9)


def test_where_nothing_is_the_farthest_layer_is_the_background() -> None:
    twin, camera, behind = random_scene(3), make_camera(20, 16), torch.tensor([0.2, 0.5, 0.7])
    twin.means[:, 2] = -100.0
    layers = render_layers(twin, camera, torch.ones(3), background=behind, settings=SMOOTH)
    assert layers.numbers == (0,)
    torch.testing.assert_close(layers.planes[0, :3], behind[:, None, None].expand(3, 16, 20))
    assert bool((layers.planes[0, 3] == 1).all())
