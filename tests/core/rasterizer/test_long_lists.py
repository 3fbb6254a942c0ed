"""Tiles of many Gaussians, Gaussians of many tiles: what the gpu back end shares out has the gradients of the whole."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from dgs.core.backends.gpu.layout import CHUNK, SATURATED
from dgs.core.devices import tensors_on
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render
from dgs.studies.stability.scenes import drawn
from dgs.tests.back_ends import or_skip
from dgs.tests.core.rasterizer.rasterizer_scenes import (
    assert_same_image,
    gradients,
    joined,
    make_camera,
    random_scene,
    relative,
)

LENGTHS = (CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 1, 4 * CHUNK + 7)
#: Logarithms of the opacity's odds, in the mean: hardly anything of the light is taken, or all of it by a few.
FAINT, OPAQUE = -5.0, 3.0


def stack(count: int, logit: float, seed: int = 0) -> Gaussians:
    """Gaussians one behind the other that each cover a frame of one tile."""
    scene = random_scene(count, 1, seed)
    scene.means[:, :2] *= 0.1
    scene.means[:, 2] = torch.linspace(2.0, 6.0, count)
    scene.log_scales += 2.8
    scene.opacity_logits = logit + 0.1 * scene.opacity_logits
    return scene


def half_covered(count: int) -> Gaussians:
    """A faint stack, and before it an opaque one beside which a part of the tile stays open."""
    near = stack(count, OPAQUE, seed=1)
    near.means[:, 0], near.means[:, 2] = -0.5, torch.linspace(1.0, 1.9, count)
    near.log_scales -= 2.2
    return joined(near, stack(count, FAINT))


def check(scene: Gaussians, backend: str, width: int = 16, height: int = 16, focal: float = 20.0) -> None:
    camera, settings = make_camera(width, height, focal), RasterSettings(depth=True)
    inputs = {"background": torch.tensor([0.2, 0.7, 0.4]), "twist": torch.full((6,), 0.01)}
    doubled = {name: value.double() for name, value in inputs.items()}
    truth, wanted = gradients(scene.to(dtype=torch.float64), camera, "reference", settings=settings, **doubled)
    found, got = gradients(scene, camera, backend, settings=settings, **inputs)
    assert_same_image(found.image, truth.image, 2e-5)
    for name, gradient in wanted.items():
        assert relative(got[name], gradient) < 1e-3, name
    # each Gaussian by itself, the last ones too: a chunk of the list may not be lost among the others
    for name in ("means", "opacity_logits", "sh"):
        far = slice(len(scene) - CHUNK // 2, None)
        assert relative(got[name][far], wanted[name][far]) < 1e-3, name


@pytest.mark.parametrize("logit", [FAINT, OPAQUE])
@pytest.mark.parametrize("count", LENGTHS)
def test_lists_of_several_chunks(backend: str, count: int, logit: float) -> None:
    check(stack(count, logit), backend)


def test_a_tile_that_is_partly_opaque(backend: str) -> None:
    check(half_covered(CHUNK + 9), backend)


def test_several_tiles_of_several_chunks(backend: str) -> None:
    """Tiles of different lengths, some beside the frame's edge, and some that see nothing."""
    few = random_scene(CHUNK // 2, 1, seed=3)
    few.opacity_logits.clamp_(max=0.0)
    check(joined(stack(2 * CHUNK + 1, FAINT), few), backend, 57, 35)


def test_gaussians_that_fill_a_frame_of_many_tiles(backend: str) -> None:
    """Their gradients are summed up by many threads, those of the small ones among them by one."""
    check(joined(random_scene(70, 1, seed=4), stack(3, 0.0), random_scene(9, 1, seed=5)), backend, 161, 145, 60.0)


def test_two_renders_before_either_backward(backend: str) -> None:
    """What one leaves for its backward pass is not the other's."""
    camera, device = make_camera(16, 16, 20.0), tensors_on(backend)  # type: ignore[arg-type]
    scenes = [stack(2 * CHUNK + 1, FAINT, seed).to(device=device) for seed in (0, 1)]

    def loss(scene: Gaussians) -> torch.Tensor:
        return render(scene, camera, backend=backend).image.square().sum()  # type: ignore[arg-type]

    alone = []
    for scene in scenes:
        scene.requires_grad_()
        alone.append(torch.autograd.grad(loss(scene), scene.means)[0].cpu())
    both = [loss(scene) for scene in scenes]
    render(scenes[0].detached(), camera, backend=backend)  # type: ignore[arg-type]
    for value, scene, wanted in reversed(list(zip(both, scenes, alone, strict=True))):
        assert torch.equal(torch.autograd.grad(value, scene.means)[0].cpu(), wanted)


#: What may stand in recycled memory: NaN; a plausible number; an old chunk's entry.
LEFTOVERS = {"nan": [0xFFC00000], "a half": [0x3F000000], "a chunk": [0, CHUNK, 0, SATURATED]}


@pytest.mark.parametrize("left", LEFTOVERS.values(), ids=LEFTOVERS)
@pytest.mark.parametrize("name", ["opaque", "half covered", "random"])
def test_the_card_s_memory_is_written_before_it_is_read(
    monkeypatch: pytest.MonkeyPatch, name: str, left: list[int]
) -> None:
    """It is recycled: a splat behind what every pixel sees has a gradient of zero, and no old one."""
    or_skip("gpu")
    from dgs.core.backends.gpu.card import Card

    clean = Card.memory

    def memory(card: Card, size: int):  # type: ignore[no-untyped-def]
        found = clean(card, size)
        card.write(found, np.resize(np.array(left, np.uint32), found.buffer.size // 4))
        return found

    stacks = {"opaque": stack(4 * CHUNK + 7, OPAQUE), "half covered": half_covered(CHUNK + 9)}
    scene, camera = stacks.get(name, random_scene(300, 1, seed=2)), make_camera(40, 20, 20.0)
    wanted = drawn(scene, camera, "gpu", RasterSettings(depth=True))
    monkeypatch.setattr(Card, "memory", memory)
    found = drawn(scene, camera, "gpu", RasterSettings(depth=True))
    assert torch.equal(found.image, wanted.image)
    for parameter, gradient in wanted.gradients.items():
        assert torch.equal(found.gradients[parameter], gradient), parameter


def test_a_render_alone_leaves_no_checkpoints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who only looks pays nothing for a backward pass."""
    or_skip("gpu")
    from dgs.core.backends.gpu import rasterizer

    left = []
    blend = rasterizer.blend
    monkeypatch.setattr(rasterizer, "blend", lambda card, p, outputs: (left.append(p), blend(card, p, outputs))[1])
    scene, camera = stack(2 * CHUNK + 1, FAINT).to(device="gpu"), make_camera(16, 16, 20.0)
    render(scene, camera)
    scene.requires_grad_()
    with torch.no_grad():
        render(scene, camera)
    render(scene, camera)
    assert [p.checkpoints.size for p in left] == [0, 0, 2 * 5 * 4 * 256]
