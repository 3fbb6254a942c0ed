"""sRGB and linear light: inverse, monotone, finite derivatives."""

import numpy as np
import torch
from dgs.core.colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear


def test_known_values_and_round_trip():
    assert np.isclose(srgb_to_linear(np.array([0.5]))[0], 0.21404, atol=1e-5)
    values = np.linspace(-1, 3, 4001)
    assert np.abs(linear_to_srgb(srgb_to_linear(values)) - values).max() < 2e-6  # the knees differ by 2e-7
    assert (np.diff(srgb_to_linear(values)) > 0).all() and (np.diff(linear_to_srgb(values)) > 0).all()
    assert srgb_to_linear(values.astype(np.float32)).dtype == np.float32


def test_torch_agrees_and_slopes_are_finite():
    values = np.array([-1e4, -0.5, 0.0, 1e-30, 0.0031308, 0.04045, 0.5, 1.0, 2.0, 1e4], dtype=np.float32)
    for function in (srgb_to_linear, linear_to_srgb):
        tensor = torch.tensor(values, requires_grad=True)
        out = function(tensor)
        assert np.allclose(out.detach().numpy(), function(values), rtol=1e-5)
        out.sum().backward()
        assert tensor.grad is not None and torch.isfinite(out).all()
        assert torch.isfinite(tensor.grad).all() and (tensor.grad > 0).all()


def test_slopes_are_the_curves_own():
    values = torch.tensor([-2.0, -0.055, -0.01, 0.0, 1e-30, 0.003, 0.0032, 0.04, 0.041, 0.5, 1.0, 2.0, 50.0])
    for curve, derivative in ((srgb_to_linear, decoding_derivative), (linear_to_srgb, encoding_derivative)):
        at = values.clone().requires_grad_()
        out = curve(at)
        (expected,) = torch.autograd.grad(out.sum(), at)
        found = derivative(values, out.detach())
        assert torch.isfinite(found).all()
        assert torch.allclose(found, expected, rtol=1e-4)
