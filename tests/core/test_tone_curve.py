"""A camera's own curve: its inverse, its slopes, its parts."""

import pytest
import torch
from dgs.core.tone_curve import ToneCurve


@pytest.mark.parametrize(("toe", "shoulder"), [(0.0, 0.0), (0.6, 0.5), (-0.2, 0.7), (-0.5, -0.5), (1.0, 1.0)])
def test_a_cameras_own_curve_has_an_inverse_and_its_slopes(toe, shoulder):
    curve = ToneCurve(toe, shoulder)
    assert bool(curve) == (toe != 0.0)
    filed = torch.linspace(-0.5, 1.6, 1051, dtype=torch.float64, requires_grad=True)
    srgb = curve.undone(filed)
    assert (torch.diff(srgb) > 0).all(), "it rises"
    assert torch.allclose(curve.filed(srgb.detach()), filed.detach(), atol=1e-5)
    (expected,) = torch.autograd.grad(srgb.sum(), filed)
    assert torch.allclose(curve.slope(filed.detach()), expected, atol=1e-12)
    ends = curve.undone(torch.tensor([0.0, 1.0]))
    assert ends.tolist() == [0.0, 1.0]
    inside = filed.detach().clamp(0.0, 1.0)
    more = ToneCurve(toe + 1, shoulder), ToneCurve(toe, shoulder + 1)
    for part, other in zip(curve.parts(inside), more, strict=True):
        assert torch.allclose(part, other.undone(inside) - curve.undone(inside), atol=1e-12)
