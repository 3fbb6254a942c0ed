"""A blur of a width that differs from px to px, and the two effects that are made of it."""

import pytest
import torch
from dgs.core.effects.defocus import Defocus
from dgs.core.effects.field_blur import FieldBlur
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.layered import LADDER, LAYERED, LayeredBlur

H, W = 48, 64


def picture(*size: int, dtype: torch.dtype = torch.float64, seed: int = 0) -> torch.Tensor:
    return torch.rand(size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64).to(dtype)


def widths(dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """[H, W] px^2, from nothing on the left to 4 px on the right, and a patch that jumps back."""
    variance = torch.linspace(0, 4, W, dtype=torch.float64).square().repeat(H, 1)
    variance[10:20, 40:50] = 0.1
    return variance.to(dtype)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
def test_the_adjoint_is_the_transpose(dtype, tolerance):
    x, y = picture(3, H, W, dtype=dtype), picture(3, H, W, dtype=dtype, seed=1)
    blur = LayeredBlur(widths(dtype))
    out = blur.apply(x)
    back, _ = blur.adjoint(y, x, out)
    assert float((out * y).sum()) == pytest.approx(float((x * back).sum()), rel=tolerance)
    assert float((x * out).sum()) != pytest.approx(float((x * x).sum()), rel=1e-3)  # it does blur


def test_compiled_passes_agree_with_the_others():
    x, y = picture(3, H, W), picture(3, H, W, seed=1)
    exact, fast = LayeredBlur(widths()), LayeredBlur(widths(torch.float32))
    out, quick = exact.apply(x), fast.apply(x.float())
    assert quick.dtype == torch.float32 and torch.allclose(quick.double(), out, atol=1e-5)
    for a, b in zip(exact.adjoint(y, x, out), fast.adjoint(y.float(), x.float(), quick), strict=True):
        assert torch.allclose(b.double(), a, atol=1e-4)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_constant_picture_stays(dtype):
    even = torch.full((3, H, W), 0.3, dtype=dtype)
    assert torch.allclose(LayeredBlur(widths(dtype)).apply(even), even, atol=1e-6)


@pytest.mark.parametrize("variance", [0.1, 0.25, 0.7, 1.3, 3.0, 9.0])
def test_a_point_gains_exactly_the_variance(variance):
    point = torch.zeros(1, 81, 81, dtype=torch.float64)
    point[0, 40, 40] = 1.0
    spread = LayeredBlur(torch.full((81, 81), variance, dtype=torch.float64)).apply(point)[0]
    at = torch.arange(81, dtype=torch.float64) - 40
    assert float(spread.sum()) == pytest.approx(1.0, abs=1e-9)
    assert float((spread * at**2).sum()) == pytest.approx(variance, rel=1e-9)
    assert float((spread * at[:, None] ** 2).sum()) == pytest.approx(variance, rel=1e-9)


def test_wider_than_the_widest_counts_as_that():
    x = picture(3, H, W)
    huge, wider = (LayeredBlur(torch.full((H, W), v, dtype=torch.float64)) for v in (1e4, 1e6))
    assert torch.equal(huge.apply(x), wider.apply(x)) and LADDER[-1] > H / 8
    out = wider.apply(x)
    assert float(wider.adjoint(x, x, out)[1].abs().max()) == 0.0


def test_a_blurred_foreground_leaves_no_dark_seam():
    x = torch.full((1, H, W), 0.5, dtype=torch.float64)
    variance = torch.zeros(H, W, dtype=torch.float64)
    variance[:, : W // 2] = 9.0
    assert torch.allclose(LayeredBlur(variance).apply(x), x, atol=1e-12)


def shot(scale: int = 1, depth: torch.Tensor | None = None) -> Shot:
    if depth is None:
        depth = torch.linspace(0.5, 2.0, W // scale, dtype=torch.float64).repeat(H // scale, 1)
    return Shot("a", H // scale, W // scale, depth=depth)


@pytest.mark.parametrize(
    "made",
    [
        lambda: Defocus(torch.tensor(0.03).double(), torch.tensor(1.1).double()),
        lambda: FieldBlur(torch.tensor(0.04).double()),
        lambda: FieldBlur(torch.tensor(-0.04).double()),
    ],
)
def test_parameters_gradients_against_differences(made):
    light, weight = picture(3, H, W), picture(3, H, W, seed=1)

    def loss(effect) -> float:
        return float((effect.forward(light, shot()) * weight).sum())

    effect = made()
    effect.forward(light, shot())
    effect.gradient(weight, light, shot())
    for name in effect.parameters:
        ends = []
        for side in (-1, 1):
            moved = made()
            moved.parameters[name] = moved.parameters[name] + side * 1e-6
            ends.append(loss(moved))
        assert float(effect.gradients[name]) == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=2e-4), name


def test_changed_parameters_are_noticed_between_forward_and_gradient():
    light, here = picture(3, H, W), shot()
    effect, fresh = (FieldBlur(torch.tensor(0.02).double()) for _ in range(2))
    effect.forward(light, here)
    for one in (effect, fresh):
        one.parameters["corner"].mul_(2.0)
    assert torch.equal(effect.gradient(light, light, here), fresh.gradient(light, light, here))


@pytest.mark.parametrize(
    "effect",
    [
        Defocus(torch.tensor(0.0), torch.tensor(1.0)),
        FieldBlur(torch.tensor(0.0)),
        FieldBlur(torch.tensor(0.9 * LAYERED.invisible / 80)),
    ],
)
def test_what_is_not_visible_costs_nothing(effect):
    light = picture(3, H, W, dtype=torch.float32)
    assert effect.forward(light, shot()) is light
    assert effect.gradient(light, light, shot()) is light


def test_the_plane_in_focus_stays_sharp_and_the_rest_goes_by_the_thin_lens():
    defocus = Defocus(torch.tensor(0.05), torch.tensor(1 / 0.8))
    sigma = defocus.variance(shot(depth=torch.tensor([[0.8, 0.4, 1.6]])), torch.zeros(3, 1, 3)).sqrt() / shot().diagonal
    assert sigma.flatten().tolist() == pytest.approx([0.0, 0.05 * 1.25, 0.05 * 0.625], abs=1e-6)


def test_the_field_is_sharp_in_the_middle_or_in_the_corner():
    here = Shot("a", 101, 151)
    for corner, sharp in ((0.01, (50, 75)), (-0.01, (0, 0))):
        variance = FieldBlur(torch.tensor(corner)).variance(here, torch.zeros(3, 101, 151))
        assert float(variance[sharp]) < 0.02 * float(variance.max())
        assert float(variance.max()) == pytest.approx((0.01 * here.diagonal) ** 2, rel=0.02)


@pytest.mark.parametrize(
    "effect", [Defocus(torch.tensor(0.03).double(), torch.tensor(1.1).double()), FieldBlur(torch.tensor(0.04).double())]
)
def test_the_same_effect_on_every_grid(effect):
    """A coarse grid shows the average of the fine one, whatever unit px are."""
    smooth = LayeredBlur(torch.full((H, W), 4.0, dtype=torch.float64)).apply(picture(3, H, W))

    def averaged(planes):
        return torch.nn.functional.avg_pool2d(planes[None], 2)[0]

    depth = averaged(shot().depth[None])[0]
    expected = averaged(effect.forward(smooth, shot()))
    found = effect.forward(averaged(smooth), shot(2, depth))
    inner = (slice(None), slice(4, -4), slice(4, -4))  # at the border the repeated px are of different sizes
    untouched = float((averaged(smooth) - expected)[inner].square().mean())
    assert float((found - expected)[inner].square().mean()) < 0.01 * untouched
    upright = Shot("b", W, H)
    assert upright.diagonal == shot().diagonal


def test_frames_reach_as_far_as_their_light_does():
    field, defocus = FieldBlur(torch.tensor(0.04)), Defocus(torch.tensor(0.06), torch.tensor(1.0))
    assert Formation().reach(W, H) == 0.0 and FieldBlur(torch.tensor(-0.04)).reach(80) == 0.0
    assert Formation([field]).reach(W, H) == pytest.approx(0.04 * 80)
    assert Formation([field, defocus]).reach(W, H) == pytest.approx(80 * 0.05)
    assert Formation([defocus]).by_depth and not Formation([field]).by_depth


def test_a_step_of_the_chain_blurs_once(monkeypatch):
    """Forward and gradient of one step share what they both need."""
    count = []
    original = LayeredBlur.apply
    monkeypatch.setattr(LayeredBlur, "apply", lambda self, light: count.append(1) or original(self, light))
    formation = Formation([Defocus(torch.tensor(0.03), torch.tensor(1.1)), FieldBlur(torch.tensor(0.04))])
    frame, here = picture(3, H, W, dtype=torch.float32), shot()
    passage = formation.passage(frame, here)
    passage.gradient(passage.reached)
    assert len(count) == 2
    formation.passage(frame.clone(), here).gradient(frame)
    assert len(count) == 4
