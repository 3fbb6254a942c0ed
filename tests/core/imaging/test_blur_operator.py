"""The blur as a linear operator: evaluations agree, adjoints are exact, borders are honest."""

import math

import numpy as np
import pytest
import torch
from dgs.core.errors import PsfError
from dgs.core.imaging.evaluations import REDUCED
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from scipy import ndimage

LOPSIDED = point_spread_from_samples(
    np.array([[0, 0, 1, 0, 0], [0, 2, 5, 1, 0], [0, 6, 9, 3, 2], [0, 1, 5, 2, 0], [0, 0, 1, 0, 0.0]])
)
CASES = [("gaussian:5", 20), ("gaussian:5", 7), ("gaussian:5", 0), ("gaussian:2,4,0", 30), ("gaussian:3,1.5,25", 5)]
ALL = ("direct", "separable", "fourier", "reduced")


def spread(name: str) -> PointSpread:
    psf = LOPSIDED if name == "lopsided" else parse_psf(name)
    assert psf is not None
    return psf


#: Which evaluations a point spread has: a turned or sampled one has no factors, and a wide round one is never summed
#: tap by tap.
OF_ROUND, OF_NARROW, OF_ANY = ("separable", "fourier", "reduced"), ALL, ("direct", "fourier")
EVALUATIONS = {
    "gaussian:5": OF_ROUND,
    "gaussian:4": OF_ROUND,
    "gaussian:2,4,0": OF_NARROW,
    "gaussian:3": OF_NARROW,
    "gaussian:3,1.5,25": OF_ANY,
    "gaussian:2,1,40": OF_ANY,
    "lopsided": OF_ANY,
}


def operators(name: str, height: int, width: int, margin: int, dtype=torch.float32) -> list[BlurOperator]:
    """One for each evaluation that this point spread must have."""
    psf = spread(name)
    return [BlurOperator(psf, height, width, margin, dtype=dtype, evaluation=e) for e in EVALUATIONS[name]]


@pytest.mark.parametrize("name", EVALUATIONS)
def test_evaluations_that_do_not_fit_a_point_spread_are_refused(name):
    for evaluation in set(ALL) - set(EVALUATIONS[name]):
        with pytest.raises(PsfError, match=f"'{evaluation}' does not fit"):
            BlurOperator(spread(name), 40, 47, 5, evaluation=evaluation)


@pytest.mark.parametrize(("name", "margin"), [*CASES, ("lopsided", 1)])
def test_evaluations_agree_with_scipy(name, margin):
    height, width = 53, 71
    frame = torch.rand(3, height + 2 * margin, width + 2 * margin, generator=torch.Generator().manual_seed(1))
    expected = ndimage.convolve(frame.double().numpy(), spread(name).kernel()[None], mode="nearest")
    expected = expected[:, margin : margin + height, margin : margin + width]
    for operator in operators(name, height, width, margin):
        tolerance = REDUCED.tolerance if operator.evaluation == "reduced" else 1e-5
        assert np.abs(operator.apply(frame).numpy() - expected).max() < tolerance, operator.evaluation


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("name", "margin"), [*CASES, ("lopsided", 1)])
def test_adjoint(name, margin, dtype):
    generator = torch.Generator().manual_seed(2)
    x = torch.randn(3, 41 + 2 * margin, 60 + 2 * margin, generator=generator, dtype=dtype)
    y = torch.randn(3, 41, 60, generator=generator, dtype=dtype)
    for operator in operators(name, 41, 60, margin, dtype):
        forward = (operator.apply(x).double() * y.double()).sum()
        backward = (x.double() * operator.adjoint(y).double()).sum()
        scale = x.double().norm() * y.double().norm()
        assert abs(forward - backward) / scale < (1e-6 if dtype == torch.float32 else 1e-12), operator.evaluation


@pytest.mark.parametrize("evaluation", ALL)
def test_gradcheck(evaluation):
    psf = spread("gaussian:2.1")
    operator = BlurOperator(psf, 9, 10, 2, dtype=torch.float64, evaluation=evaluation)
    x = torch.rand(1, 13, 14, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(operator, (x,))


@pytest.mark.parametrize("psf", [None, PointSpread(), spread("gaussian:0,0,30")])
def test_no_psf_is_the_very_same_tensor(psf):
    frame = torch.rand(3, 8, 9, requires_grad=True)
    operator = BlurOperator(psf, 8, 9)
    assert operator(frame) is frame and operator.apply(frame) is frame and operator.adjoint(frame) is frame
    cropped = BlurOperator(psf, 4, 5, 2)(frame)
    assert torch.equal(cropped, frame[:, 2:-2, 2:-2])


@pytest.mark.parametrize(("name", "margin"), CASES)
def test_constant_image_is_invariant(name, margin):
    for operator in operators(name, 40, 47, margin):
        frame = torch.full((3, 40 + 2 * margin, 47 + 2 * margin), 0.7)
        assert (operator.apply(frame) - 0.7).abs().max() < 2e-6, operator.evaluation


@pytest.mark.parametrize("name", ["gaussian:3", "gaussian:2,1,40", "lopsided"])
def test_centroid_of_a_blurred_point_stays(name):
    for operator in operators(name, 61, 61, 0):
        frame = torch.zeros(1, 61, 61)
        frame[0, 30, 30] = 1.0
        out = operator.apply(frame)[0].double()
        offset = torch.arange(61) - 30.0
        assert abs((out.sum(dim=0) * offset).sum()) < 1e-4 and abs((out.sum(dim=1) * offset).sum()) < 1e-4
        assert out.sum() == pytest.approx(1.0, abs=1e-4)


def test_corner_point_does_not_wrap():
    for operator in operators("gaussian:4", 50, 60, 3):
        frame = torch.zeros(1, 56, 66)
        frame[0, 0, 0] = 1.0
        out = operator.apply(frame)[0]
        assert out[-20:].abs().max() < 1e-6 and out[:, -20:].abs().max() < 1e-6


def test_two_tone_edge_matches_the_error_function():
    width, sigma = 81, 4.0
    frame = torch.full((1, 30, width), 0.2)
    frame[:, :, 40:] = 0.9
    out = BlurOperator(spread(f"gaussian:{sigma}"), 30, width).apply(frame)[0, 15]
    for x in range(25, 56):
        # The edge lies between px 39 and 40; a sampled sum is off the integral by slope / 24.
        expected = 0.2 + 0.7 * 0.5 * (1 + math.erf((x - 39.5) / (sigma * math.sqrt(2))))
        assert out[x] == pytest.approx(expected, abs=6e-4)


def test_psf_wider_than_the_photo_is_refused():
    with pytest.raises(PsfError, match="photos of 40 x 30"):
        BlurOperator(spread("gaussian:16"), 30, 40)


def test_measured_choice_is_remembered():
    psf = spread("gaussian:3")
    first, second = BlurOperator(psf, 40, 50, 4), BlurOperator(psf, 40, 50, 4)
    assert first.evaluation == second.evaluation and first.evaluation in ALL
    with pytest.raises(PsfError, match="reduced"):
        BlurOperator(LOPSIDED, 40, 50, evaluation="reduced")


def test_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="expected"):
        BlurOperator(spread("gaussian:1"), 20, 20, 4).apply(torch.zeros(3, 20, 20))
