"""Frames along a camera's path on a graphics card: each as from its own pose, all with one wait; what is learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.devices import all_in_memory
from dgs.core.forward.collecting import collected
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.rasterizer import render, render_path
from dgs.core.tone_curve import ToneCurve
from dgs.core.training.trainer import Trainer
from dgs.tests.back_ends import brought_up, or_skip
from dgs.tests.core.rasterizer.test_frames_along_a_path import SETTINGS, camera, gaussians, poses
from dgs.tests.core.training.moved_photos import truly_moved
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene


@pytest.fixture
def card():
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    return card()


def widely_seen() -> Gaussians:
    """Gaussians, one of which fills the frame: it meets more tiles than a group of threads has slots for."""
    twin = gaussians(400)
    with torch.no_grad():
        twin.log_scales[7] = 1.5
    return twin


def drawn(twin: Gaussians, path: torch.Tensor, upstream: torch.Tensor, device: str) -> tuple[torch.Tensor, dict]:
    """Images along a path, all at once on the card and one by one by the reference in float64, and gradients."""
    behind, settings = torch.tensor([0.2, 0.4, 0.6]), replace(SETTINGS, antialias=True)
    if device == "gpu":
        mine = twin.to("gpu").requires_grad_()
        images = render_path(mine, camera(), path, background=behind, settings=settings).images
        (images * upstream.to("gpu")).sum().backward()
    else:
        mine = twin.to(dtype=torch.float64).requires_grad_()
        views = [render(mine, camera(), background=behind.double(), pose=p.double(), settings=settings) for p in path]
        images = torch.stack([view.image for view in views])
        (images * upstream.double()).sum().backward()
    return images.detach().cpu(), {name: tensor.grad.cpu().double() for name, tensor in mine.named()}


@pytest.mark.parametrize("frames", [1, 2, 9])
def test_images_and_gradients_are_those_of_one_render_each(card, frames):
    """Nothing is shared along the path: each frame has shapes, colours and an order of its own."""
    path = poses(8.0, frames).double()
    upstream = torch.randn(frames, 3, camera().height, camera().width, generator=torch.Generator().manual_seed(3))
    twin = widely_seen().detached()
    (images, gradients), (truth, wanted) = (drawn(twin, path, upstream, device) for device in ("gpu", "reference"))
    assert float((images - truth).abs().max()) < 2e-5
    for name, expected in wanted.items():
        assert float((gradients[name] - expected).norm() / expected.norm()) < 1e-3, name


def test_one_wait_serves_all_frames(card):
    twin, path = gaussians().detached().to("gpu"), poses(8.0, 9)
    for _ in range(2):
        card.traffic.waits = card.traffic.orders = 0
        render_path(twin, camera(), path, settings=SETTINGS)
    together = card.traffic.orders
    assert card.traffic.waits == 1
    card.traffic.orders = 0
    render(twin, camera(), pose=path[0], settings=SETTINGS)
    assert together <= card.traffic.orders + 4, "(wider keys take a pass more)"


def test_the_same_path_twice_is_the_same_to_the_bit(card):
    path, upstream = poses(8.0, 5), torch.ones(5, 3, camera().height, camera().width)
    one, other = (drawn(widely_seen().detached(), path, upstream, "gpu") for _ in range(2))
    assert torch.equal(one[0], other[0]) and all(torch.equal(one[1][name], other[1][name]) for name in one[1])


def test_statistics_are_of_all_frames(card):
    twin, path = gaussians().detached().to("gpu").requires_grad_(), poses(8.0, 5)
    found = render_path(twin, camera(), path, settings=SETTINGS)
    found.images.sum().backward()
    (screen,) = found.screens
    radii = [render(twin, camera(), pose=pose, settings=SETTINGS).screen.radius.cpu() for pose in path]
    assert torch.equal(screen.radius.cpu(), torch.stack(radii).amax(dim=0))
    assert screen.mean_gradient is not None and screen.mean_gradient.shape == (len(twin), 2)


def test_a_path_without_gaussians_and_one_beside_the_frame(card):
    path, behind = poses(4.0, 3), torch.tensor([0.1, 0.2, 0.3])
    empty = Gaussians(**{name: tensor.detach()[:0] for name, tensor in gaussians().named()}).to("gpu")
    away = path.clone()
    away[:, 0, 3] += 1e3
    for twin, way in ((empty, path), (gaussians().detached().to("gpu"), away)):
        found = render_path(twin, camera(), way, background=behind, settings=SETTINGS).images.cpu()
        assert torch.allclose(found, behind[None, :, None, None].expand_as(found))


@pytest.mark.parametrize("curve", [ToneCurve(), ToneCurve(-0.2, 0.7)])
@pytest.mark.parametrize("weights", [[0.2, 0.5, 0.3], "rows", "columns"])
def test_light_is_collected_on_the_card_as_in_memory(card, weights, curve):
    random = torch.Generator().manual_seed(0)
    frames, upstream = torch.rand(3, 3, 11, 17, generator=random), torch.randn(3, 11, 17, generator=random)
    if isinstance(weights, str):
        shares = torch.rand(3, 11, 1, generator=random) if weights == "rows" else torch.rand(3, 1, 17, generator=random)
        weights = shares / shares.sum(dim=0)
    own = collected(list(frames.double()), weights if isinstance(weights, list) else weights.double(), "linear", curve)
    there = collected(list(brought_up(frames)), weights, "linear", curve)
    assert torch.allclose(there.shown.cpu().double(), own.shown, atol=3e-6)
    parts = zip(there.gradient(brought_up(upstream)), own.gradient(upstream.double()), strict=True)
    for found, expected in parts:
        assert torch.allclose(found.cpu().double(), expected, atol=2e-5)


def test_parts_come_with_one_wait(card):
    parts = [brought_up(torch.rand(3, 5, 7)), brought_up(torch.rand(2, 4))]
    card.traffic.waits = 0
    one, other = all_in_memory(parts[0][:, 1:4:2, ::3], parts[1])
    assert card.traffic.waits == 1 and one.device.type == other.device.type == "cpu"
    assert torch.equal(one, parts[0].cpu()[:, 1:4:2, ::3]) and torch.equal(other, parts[1].cpu())


def test_a_shaken_training_ends_where_the_cpu_s_does(card):
    """Paths are learned, and compared with others, on either device."""
    scene = blurred_scene(4)
    ways = {view.name: (0.02, 0.01 * i) for i, view in enumerate(scene.views)}
    losses = {}
    for device in ("cpu", "gpu"):
        settings = replace(SHORT, device=device, steps=24)
        paths = Formation([straight_paths(ways, 2)])
        trainer = Trainer(scene.views, [], scene.points, Medium(None), settings, paths)
        losses[device] = np.mean([float(trainer.advance(step / 24)) for step in range(24)][-8:])
    assert losses["gpu"] == pytest.approx(losses["cpu"], rel=0.05), losses


def test_photos_are_restored_on_the_card_as_in_memory(card):
    """What is restored is computed in memory from what the card shows; the new Gaussians are the card's."""
    scene = blurred_scene()
    _, views = truly_moved(scene, px=7.0)
    shares = [*np.linspace(0.0, 0.59, 12), *np.linspace(0.6, 0.84, 4), 0.9]
    losses = []
    for device in ("gpu", "cpu"):
        paths = straight_paths({view.name: (0.0, 0.0) for view in views}, 1)
        settings = replace(SHORT, steps=240, device=device)
        trainer = Trainer(views, [], scene.points, Medium(), settings, Formation([paths]))
        trainer.restore = True
        losses.append([float(trainer.advance(float(share))) for share in shares])
        assert trainer.optimizer.gaussians.means.device.type == device and trainer.restored_around is None
    assert np.allclose(*losses, rtol=0.03)
