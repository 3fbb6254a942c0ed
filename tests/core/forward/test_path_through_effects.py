"""Frames along a path whose light passes the effects once it is collected, against frames that pass them one by one."""

from dataclasses import replace

import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.forward import ForwardModel, medium_of
from dgs.core.forward.medium import SubFrame
from dgs.core.frames import Frame
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.rasterizer import RasterSettings, render, with_gradient
from dgs.tests.core.training.training_scenes import blurred_scene

SETTINGS = RasterSettings(low_pass=0.5, depth=True)


class Photo:
    """What the forward model asks of one."""

    def __init__(self, camera):
        self.name, self.camera, self.psf = camera.name, camera, None


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


@pytest.fixture
def path(scene):
    camera = scene.views[0].camera
    return straight_paths({camera.name: (4.0 / camera.fx, 2.0 / camera.fx)}, 2)


def lens(camera):
    return LensFocus([camera.name], torch.tensor([0.03]), torch.tensor([0.7]))


def model_of(camera, *effects):
    return ForwardModel(
        SETTINGS, lambda _: medium_of(None, Frame(camera.height, camera.width, 0)), 0, Formation(effects)
    )


def one_by_one(model, twin, camera, poses, effect):
    """The photo, and what takes a gradient in it back to the twin: every frame blurred by its own depth."""
    passages, renders = [], []
    for pose in poses:
        drawn = render(twin, camera, pose=pose, settings=SETTINGS)
        depth = model.surface(twin, SubFrame(camera, pose), drawn)
        shot = Shot(camera.name, camera.height, camera.width, 0, (camera.cx, camera.cy), depth)
        renders.append(drawn)
        passages.append(Formation([effect]).passage(drawn.image.detach(), shot))
    leaves = [passage.reached.clone().requires_grad_() for passage in passages]
    shown = linear_to_srgb(torch.stack([srgb_to_linear(leaf) for leaf in leaves]).mean(dim=0))

    def back(upstream):
        shown.backward(upstream)
        parts = [p.gradient(leaf.grad) for p, leaf in zip(passages, leaves, strict=True)]
        total = sum(with_gradient(r.image, part) for r, part in zip(renders, parts, strict=True))
        total.backward()

    return shown.detach(), back


def test_it_is_what_frames_show_that_pass_one_by_one(scene, path):
    camera, effect = scene.views[0].camera, lens(scene.views[0].camera)
    model, upstream = model_of(camera, path, effect), None
    shown, gradients = [], []
    for together in (True, False):
        twin = replace(scene.truth, **{n: t.detach().clone().requires_grad_() for n, t in scene.truth.named()})
        if together:
            exposed = model.expose(twin, Photo(camera))
            assert len(exposed.frames) > 2, "a path"
            assert exposed.together is not None
            photo, back = exposed.reached, exposed.backward
        else:
            photo, back = one_by_one(model, twin, camera, path.poses(camera.name, camera), effect)
        upstream = (
            torch.randn(photo.shape, generator=torch.Generator().manual_seed(1)) if upstream is None else upstream
        )
        back(upstream)
        shown.append(photo)
        gradients.append(torch.cat([twin.means.grad.reshape(-1), twin.sh.grad.reshape(-1)]))
    sharp = model_of(camera, path).expose(scene.truth, Photo(camera)).reached
    apart = (shown[0] - shown[1]).square().mean().sqrt()
    assert float(apart) < 0.1 * float((sharp - shown[1]).square().mean().sqrt()), "little beside what the lens does"
    assert float(torch.corrcoef(torch.stack(gradients))[0, 1]) > 0.98


def test_effects_that_follow_no_depth_ask_for_none(scene, path):
    camera = scene.views[0].camera
    exposed = model_of(camera, path).expose(scene.truth, Photo(camera))
    assert exposed.together is None
    assert exposed.shot.depth is None


def test_the_gradient_reaches_the_depth(scene, path):
    """Off the focus, the middle frame's depth says how wide everything is: Gaussians hear of it."""
    camera, effect = scene.views[0].camera, lens(scene.views[0].camera)
    twin = replace(scene.truth, **{n: t.detach().clone().requires_grad_() for n, t in scene.truth.named()})
    exposed = model_of(camera, path, effect).expose(twin, Photo(camera))
    exposed.backward(torch.ones_like(exposed.reached))
    assert exposed.together.passage.depth_gradient is not None
    assert exposed.together.middle.depth.requires_grad
