"""Blur by depth with occlusion: gradients, occlusion against a lens that is sampled, and its limits."""

import numpy as np
import pytest
import torch
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.focus import FOCUS, LensFocus
from dgs.core.imaging.formation.layered import LayeredBlur
from dgs.core.imaging.formation.occluding import OccludingBlur, disk
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from scipy import ndimage

H, W = 40, 56


def smooth(seed: int, width: float, height: int = H, breadth: int = W) -> torch.Tensor:
    """[3, h, w] in [0, 1], float64."""
    planes = ndimage.gaussian_filter(np.random.default_rng(seed).uniform(size=(3, height, breadth)), (0, width, width))
    return torch.from_numpy((planes - planes.min()) / np.ptp(planes))


def steep(seed: int = 3) -> torch.Tensor:
    """[H, W] widths on both sides of the sharp plane, with a step, px."""
    width = (smooth(seed, 5.0)[0] - 0.5) * 2.0
    width[10:25, 12:30] += 0.6
    return width.clamp(-1.2, 1.2)


@pytest.mark.parametrize("shape", ["disk", "gaussian"])
def test_gradients_against_autograd_and_differences(shape):
    light, weight, width = smooth(0, 0.5), smooth(1, 0.5), steep()
    x, w = light.clone().requires_grad_(), width.clone().requires_grad_()
    (OccludingBlur(w, shape).apply(x) * weight).sum().backward()
    blur = OccludingBlur(width, shape)
    in_light, in_width = blur.adjoint(weight, light, blur.apply(light))
    assert torch.allclose(in_light, x.grad, atol=1e-12)
    assert torch.allclose(in_width, w.grad, atol=1e-9)
    mixed = torch.from_numpy(np.random.default_rng(0).uniform(size=(1, H, W))).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: OccludingBlur(width, shape).apply(v), (mixed,), fast_mode=True)


@pytest.mark.parametrize("effect", [LensFocus])
def test_strength_focus_and_depth_against_differences(effect):
    light, weight = smooth(0, 0.5), smooth(1, 0.5)
    depth = 0.6 + smooth(4, 5.0)[0]

    def made(strength: float, focus: float) -> LensFocus:
        return effect(["a"], *(torch.tensor([value], dtype=torch.float64) for value in (strength, focus)))

    def loss(one, where) -> float:
        return float((one.forward(light, Shot("a", H, W, depth=where)) * weight).sum())

    here, one = Shot("a", H, W, depth=depth), made(0.03, 1.0)
    one.forward(light, here)
    one.gradient(weight, light, here)
    for key, by in (("strengths", (1e-6, 0.0)), ("foci", (0.0, 1e-6))):
        ends = [loss(made(0.03 + side * by[0], 1.0 + side * by[1]), depth) for side in (-1, 1)]
        assert float(one.gradients[key]) == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-5), key
    way = smooth(5, 3.0)[0]
    ends = [loss(made(0.03, 1.0), depth + side * 1e-6 * way) for side in (-1, 1)]
    assert float((one.depth_gradient * way).sum()) == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-5)


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.0])
def test_what_is_sharp_and_near_does_not_take_in_what_is_blurred_behind_it(sigma):
    """Against a lens whose hole is sampled: what is behind the disk is seen past its edge."""
    height, width = 120, 160
    near, far = 0.4 + 0.6 * smooth(0, 1.0, height, width), 0.6 * smooth(1, 1.0, height, width)
    y, x = np.mgrid[:height, :width]
    mask = torch.from_numpy(((x - 80) ** 2 + (y - 60) ** 2 < 35**2).astype(float))[None]
    lens = BlurOperator(PointSpread("file", samples=disk(sigma)), height, width, 0, "cpu", torch.float64)
    covered = lens.apply(mask)
    edge = ((covered > 0.002) & (covered < 0.998))[0]
    seen = mask * near + (1 - mask) * far
    sharp_near = mask * near + (1 - mask) * lens.apply(far)
    sharp_far = lens.apply(mask * near) + (1 - covered) * far

    def error(blurred, true, part):
        return float((blurred - true)[:, part].square().mean().sqrt())

    inside, outside = edge & (mask[0] > 0), edge & (mask[0] == 0)
    behind, before = -sigma * (1 - mask[0]), sigma * mask[0]
    assert error(OccludingBlur(behind, "disk").apply(seen), sharp_near, inside) < 1e-6
    assert error(LayeredBlur(behind**2).apply(seen), sharp_near, inside) > 0.02  # (what it would be)
    one, other = (blur.apply(seen) for blur in (OccludingBlur(before, "disk"), LayeredBlur(before**2)))
    assert error(one, sharp_far, outside) < 0.5 * error(other, sharp_far, outside)


def test_disks_have_the_width_that_they_are_asked_for():
    for sigma in (1.28, 2.05, 3.3, 5.2):
        kernel = disk(sigma)
        at = np.arange(len(kernel)) - len(kernel) // 2
        assert np.sqrt(kernel.sum(axis=0) @ at**2) == pytest.approx(sigma, rel=0.02)
        assert kernel.sum() == pytest.approx(1.0) and kernel[0, 0] == 0.0


def test_nothing_out_of_focus_is_the_very_same_light():
    light = smooth(0, 0.5).float()
    for strength, focus in ((0.0, 1.0), (1e-4, 1.0)):
        one = LensFocus(["a"], torch.tensor([strength]), torch.tensor([focus]))
        assert one.forward(light, Shot("a", H, W, depth=torch.ones(H, W))) is light
    one = LensFocus(["a"], torch.tensor([0.1]), torch.tensor([0.0]))
    assert one.forward(light, Shot("other", H, W, depth=torch.ones(H, W))) is light
    assert one.gradient(light, light, Shot("other", H, W, depth=torch.ones(H, W))) is light
    assert (
        FOCUS.nearest_depth > 0 and torch.isfinite(one.forward(light, Shot("a", H, W, depth=torch.zeros(H, W)))).all()
    )


@pytest.mark.parametrize("width", [-99.0, -1.0, 99.0])
def test_what_is_all_equally_far_off_is_blurred_evenly(width):
    """As wide as the frame allows at most, in front of the sharp plane and behind it alike."""
    light = smooth(0, 0.5)
    one, other = (OccludingBlur(torch.full((H, W), side * width).double(), "disk").apply(light) for side in (1, -1))
    assert torch.allclose(one, other) and float((one - light).abs().max()) > 0.01


def test_a_depth_of_another_frame_is_refused():
    one = LensFocus(["a"], torch.tensor([0.1]), torch.tensor([0.0]))
    with pytest.raises(ValueError, match="own frame"):
        one.forward(smooth(0, 0.5), Shot("a", H, W, depth=torch.ones(H + 2, W)))
