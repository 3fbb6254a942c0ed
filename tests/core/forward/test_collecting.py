"""Light of several frames on one sensor: the kernels against the formula, values and gradients."""

import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.forward.collecting import CollectedLight, collected
from dgs.core.tone_curve import ToneCurve


def reference(frames, weights):
    return linear_to_srgb(sum(w * srgb_to_linear(f) for w, f in zip(weights, frames, strict=True)))


@pytest.mark.parametrize("count", [2, 5])
def test_values_and_gradients_are_those_of_the_formula(count):
    random = torch.Generator().manual_seed(count)
    frames = [torch.rand(3, 37, 53, generator=random) * 1.3 - 0.1 for _ in range(count)]
    weights = [(i + 1) / (count * (count + 1) / 2) for i in range(count)]
    found = CollectedLight(frames, weights)
    doubles = [frame.double().requires_grad_() for frame in frames]
    shown = reference(doubles, weights)
    assert torch.allclose(found.shown.double(), shown, atol=2e-6)
    assert torch.allclose(found.light.double(), srgb_to_linear(shown), atol=2e-6)
    upstream = torch.randn(3, 37, 53, generator=random)
    (shown * upstream.double()).sum().backward()
    for frame, gradient in zip(doubles, found.gradient(upstream), strict=True):
        assert torch.allclose(gradient.double(), frame.grad, rtol=2e-4, atol=1e-5)


def test_rows_may_have_shares_of_their_own():
    """The kernels, and torch in double precision: each row as if it were a photo of its own with its shares."""
    random = torch.Generator().manual_seed(7)
    frames = [torch.rand(3, 6, 9, generator=random) for _ in range(4)]
    shares = torch.rand(4, 6, generator=random)
    shares = shares / shares.sum(dim=0)
    upstream = torch.randn(3, 6, 9, generator=random)
    for kind, tolerance in ((torch.float32, 2e-4), (torch.float64, 1e-12)):
        one = [frame.to(kind) for frame in frames]
        found = collected(one, shares[..., None].to(kind), "linear")
        gradients = found.gradient(upstream.to(kind))
        for row in range(6):
            alone = collected([f[:, row : row + 1] for f in one], shares[:, row].to(kind).tolist(), "linear")
            assert torch.allclose(found.shown[:, row], alone.shown[:, 0], rtol=0, atol=max(tolerance / 100, 1e-7))
            for mine, own in zip(gradients, alone.gradient(upstream[:, row : row + 1].to(kind)), strict=True):
                assert torch.allclose(mine[:, row], own[:, 0], rtol=tolerance, atol=1e-6)


def test_the_very_ends_of_the_curve():
    ends = torch.tensor([0.0, 0.04045, 0.0405, 0.5, 1.0 - 1e-7, 1.0, 1.5]).expand(3, 1, 7).contiguous()
    assert torch.allclose(CollectedLight([ends, ends], [0.5, 0.5]).shown, ends, atol=2e-6)


def test_columns_of_a_photo_that_was_turned_upright_are_rows_of_its_sensor():
    random = torch.Generator().manual_seed(4)
    frames = [torch.rand(3, 12, 9, generator=random) for _ in range(4)]
    shares = torch.rand(4, 1, 9, generator=random)
    shares /= shares.sum(dim=0)
    found, upstream = collected(frames, shares, "linear"), torch.rand(3, 12, 9, generator=random)
    taken = collected([frame.mT.contiguous() for frame in frames], shares.mT, "linear")
    assert torch.equal(found.shown, taken.shown.mT)
    double = collected([frame.double() for frame in frames], shares.double(), "linear")
    assert torch.allclose(found.shown.double(), double.shown, atol=1e-5)
    for own, other in zip(found.gradient(upstream), double.gradient(upstream.double()), strict=True):
        assert torch.allclose(own.double(), other, atol=1e-4)


@pytest.mark.parametrize("curve", [ToneCurve(0.6, 0.5), ToneCurve(-0.2, 0.7)])
def test_a_cameras_own_curve_files_the_light(curve):
    """The kernels against the formula, and the formula's gradient against differences."""
    random = torch.Generator().manual_seed(11)
    frames = [torch.rand(3, 5, 7, generator=random) * 1.2 - 0.1 for _ in range(3)]
    upstream, shares = torch.randn(3, 5, 7, generator=random), [0.2, 0.5, 0.3]
    found = collected(frames, shares, "linear", curve)
    doubles = [frame.double() for frame in frames]
    right = collected(doubles, shares, "linear", curve)
    assert torch.allclose(found.shown.double(), right.shown, atol=5e-6)
    light = sum(w * srgb_to_linear(curve.undone(f)) for w, f in zip(shares, doubles, strict=True))
    assert torch.allclose(srgb_to_linear(curve.undone(right.shown)), light, atol=1e-6)
    gradients = right.gradient(upstream.double())
    for mine, exact in zip(found.gradient(upstream), gradients, strict=True):
        assert torch.allclose(mine.double(), exact, rtol=5e-4, atol=2e-5)
    step = 1e-6
    for k, way in enumerate(torch.randn(3, 3, 5, 7, generator=random).double()):
        moved = [[f + sign * step * way if i == k else f for i, f in enumerate(doubles)] for sign in (1, -1)]
        up, down = (collected(some, shares, "linear", curve).shown for some in moved)
        change = ((up - down) / (2 * step) * upstream).sum()
        assert float(change) == pytest.approx(float((gradients[k] * way).sum()), rel=1e-4, abs=1e-4)


def test_no_curve_is_the_very_same_light():
    frames = [torch.rand(3, 5, 7, generator=torch.Generator().manual_seed(k)) for k in range(3)]
    plain, same = (collected(frames, [0.2, 0.5, 0.3], "linear", *more) for more in ((), (ToneCurve(),)))
    assert torch.equal(plain.shown, same.shown)
