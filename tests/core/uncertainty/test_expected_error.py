"""The expected error of sharp views: its parts, their weights, and whether it is about as large as the true one."""

from dataclasses import replace

import pytest
import torch
from dgs.core.uncertainty.detail import Detail
from dgs.core.uncertainty.expected_error import PARTS, ExpectedError, ExpectedErrorSettings, painted, steepness, weighed
from dgs.core.uncertainty.linear_model import LinearModel
from dgs.core.uncertainty.posterior import sample_posterior
from dgs.tests.core.uncertainty.uncertainty_scenes import camera, linear_model_at

NOISE = 0.01
USUAL = ExpectedErrorSettings().usual_weights
WHERE = [camera(x, look=0.0) for x in (-0.5, 0.0, 0.5)]
HELD, ELSEWHERE = camera(0.25, look=0.0), camera(-0.25, look=0.0)


def model_of(linear, wanted=()):
    kind = type(linear.viewpoints[0])
    detail = Detail(linear, NOISE, [*linear.viewpoints, *(kind(c, None) for c in wanted)], linear.viewpoints)
    return ExpectedError(detail, sample_posterior(linear, linear.viewpoints, NOISE, 4, 4), linear.viewpoints, 0.04)


def test_weights_are_found_from_residuals_and_stay_usual_without():
    generator = torch.Generator().manual_seed(3)
    shapes = torch.rand((len(PARTS), 6000), generator=generator) ** 4 * 0.01
    true = torch.tensor([2.0, 0.5, 0.1, 1.0, 0.3, 4.0])
    variance = (true[:, None] * shapes).sum(dim=0)
    residuals = variance * torch.randn(6000, generator=generator).square()
    torch.testing.assert_close(weighed(shapes, residuals, trust=1.0), true, rtol=0.35, atol=0.1)
    torch.testing.assert_close(weighed(shapes, residuals, trust=1e9), torch.tensor(USUAL), rtol=1e-3, atol=1e-4)
    model = model_of(linear_model_at(WHERE, 1.5))
    model.fit([])
    assert model.weights.tolist() == pytest.approx(list(USUAL)) and model.patches == 0


def test_values_are_painted_as_they_are():
    linear = linear_model_at([camera(0.0)], 0.0)
    right = linear.gaussians.means[:, :1].clamp(min=0.0)
    values = torch.cat([torch.full_like(right, 0.003), right], dim=1)
    planes, alpha = painted(linear, values, linear.viewpoints[0])
    inside = alpha > 0.9
    torch.testing.assert_close(planes[0][inside], torch.full_like(planes[0][inside], 0.003), rtol=1e-3, atol=1e-6)
    assert float(planes[1][:, :16][inside[:, :16]].max()) < 0.05 < float(planes[1][:, 36:][inside[:, 36:]].min())


def test_steepness_is_the_squared_gradient():
    across = torch.linspace(0.0, 1.0, 11).expand(3, 7, 11)
    torch.testing.assert_close(steepness(across)[:, 1:-1], torch.full((7, 9), 0.01))


def test_what_no_photo_resolved_is_open_and_the_blur_hides_it():
    linear = linear_model_at([camera(0.0)], 1.5)
    kind = type(linear.viewpoints[0])
    model = model_of(linear)
    same, aside = (model.shapes(kind(c, linear.viewpoints[0].psf)) for c in (camera(0.0), camera(-2.0, -0.8, 0.0)))
    middle = (slice(12, 20), slice(20, 28))
    detail, depth = PARTS.index("detail"), PARTS.index("depth")
    assert float(aside.sharp[detail][middle].mean()) > 1.2 * float(same.sharp[detail][middle].mean())
    assert float(same.sharp[depth][middle].max()) < 0.01 * float(aside.sharp[depth][middle].max())
    for shapes in (same, aside):
        assert float(shapes.photo[detail][middle].mean()) < 0.7 * float(shapes.sharp[detail][middle].mean())
    assert model.detail.resolved(linear.viewpoints[0]).shape == (len(linear.gaussians), len(model.detail.octaves))


def off_by(shift):
    """A twin that stands `shift` too far to the right, and its expected and true rms error elsewhere."""
    linear = linear_model_at(WHERE, 1.5)
    kind, psf = type(linear.viewpoints[0]), linear.viewpoints[0].psf
    moved = replace(linear.gaussians, means=linear.gaussians.means + torch.tensor([shift, 0.0, 0.0]))
    twin = LinearModel(moved, linear.viewpoints, linear.margin, torch.zeros(3), linear.settings)
    model = model_of(twin, [ELSEWHERE])
    model.fit([(kind(c, psf), linear.photo(kind(c, psf))) for c in (HELD, camera(-0.1), camera(0.4, -2.2))])
    assert model.patches > 300
    viewpoint = kind(ELSEWHERE, None)
    m = linear.margin
    true = (twin.unmoved(viewpoint) - linear.unmoved(viewpoint))[:, m:-m, m:-m].square().mean().sqrt()
    return float(model.deviation(viewpoint).square().mean().sqrt()), float(true)


def test_the_worse_the_held_out_photos_fit_the_more_is_expected():
    (little, _), (much, true) = off_by(0.01), off_by(0.08)
    assert much > 1.2 * little
    assert 1 / 1.5 < much / true < 1.5
