"""Light of several frames on one sensor: the kernels against the formula, values and gradients."""

import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.forward.collecting import CollectedLight


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


def test_the_very_ends_of_the_curve():
    ends = torch.tensor([0.0, 0.04045, 0.0405, 0.5, 1.0 - 1e-7, 1.0, 1.5]).expand(3, 1, 7).contiguous()
    assert torch.allclose(CollectedLight([ends, ends], [0.5, 0.5]).shown, ends, atol=2e-6)
