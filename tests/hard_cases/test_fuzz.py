"""Property-based fuzz (hypothesis): anything goes in; finite values come out, or the splat is culled and counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.constants import ALPHA_MINIMUM
from dgs.core.errors import PsfError
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.loss.photometric import PhotometricLoss, photometric_reference
from dgs.studies.stability.fuzz import Fuzzer, fuzz
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

QUICK = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
ANY = st.floats(width=32)
FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)
BACKENDS = ("reference", "cpu")


def packed(flat: NDArray[np.float32], count: int, coefficients: int) -> Gaussians:
    """Gaussians from one flat array of parameters [count, 11 + 3 coefficients], as a property-based test draws it."""
    rows = torch.from_numpy(np.ascontiguousarray(flat.reshape(count, 11 + 3 * coefficients)))
    return Gaussians(
        rows[:, :3].contiguous(),
        rows[:, 3:6].contiguous(),
        rows[:, 6:10].contiguous(),
        rows[:, 10].contiguous(),
        rows[:, 11:].reshape(count, coefficients, 3).contiguous(),
    )


@st.composite
def scenes(draw, element=ANY):
    """A few Gaussians of any floats around ordinary ones, a lens, and settings."""
    count, degree = draw(st.integers(1, 4)), draw(st.integers(0, 2))
    coefficients = (degree + 1) ** 2
    ordinary = np.concatenate([[0, 0, 3, -2, -2, -2, 1, 0, 0, 0, 1], np.full(3 * coefficients, 0.3)]).astype(np.float32)
    values = np.tile(ordinary, count)
    for _ in range(draw(st.integers(0, 6))):
        values[draw(st.integers(0, values.size - 1))] = draw(element)
    width, height = draw(st.sampled_from([(1, 1), (16, 16), (33, 20), (5, 70)]))
    focal = draw(st.floats(0.5, 1e4))
    camera = Camera("", width, height, focal, focal, width / 2, height / 2, np.eye(3), np.zeros(3))
    how = RasterSettings(
        low_pass=draw(st.sampled_from([0.05, 0.3, 2.0])),
        antialias=draw(st.booleans()),
        depth=draw(st.booleans()),
        alpha_minimum=draw(st.sampled_from([ALPHA_MINIMUM, 0.0])),
    )
    return packed(values, count, coefficients), camera, how


@pytest.mark.parametrize("backend", BACKENDS)
@given(drawn=scenes())
@QUICK
def test_any_parameters(backend, drawn):
    scene, camera, how = drawn
    fuzzer = Fuzzer(backend)
    assert fuzzer.through(scene, camera, how, np.random.default_rng(0), 0), fuzzer.found


@pytest.mark.parametrize("backend", BACKENDS)
@given(
    scale=st.floats(1.0, 1e12), turn=arrays(np.float32, 4, elements=st.floats(-1, 1, width=32)), logit=st.floats(-4, 8)
)
@QUICK
def test_a_giant_before_the_camera_must_not_be_culled(backend, scale, turn, logit):
    if np.linalg.norm(turn) < 1e-6:
        turn = np.array([1, 0, 0, 0], np.float32)
    scene = packed(np.array([0, 0, 3, *[math.log(scale)] * 3, *turn, logit, 1, 1, 1], np.float32), 1, 1)
    camera = Camera("", 24, 16, 20.0, 20.0, 12.0, 8.0, np.eye(3), np.zeros(3))
    view = render(scene, camera, backend=backend)
    expected = min(1 / (1 + math.exp(-logit)), 0.99)
    # (a Gaussian of scale 1 at a distance of 3 falls to a sixth at this frame's corner)
    assert float(view.alpha.max()) == pytest.approx(expected, abs=0.02)
    assert scale < 100 or float(view.alpha.min()) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("backend", BACKENDS)
@given(z=st.floats(-1e30, 0.00999), x=FINITE, y=FINITE)
@QUICK
def test_what_is_not_before_the_near_plane_must_be_culled(backend, z, x, y):
    scene = packed(np.array([x, y, z, 0, 0, 0, 1, 0, 0, 0, 3, 1, 1, 1], np.float32), 1, 1)
    camera = Camera("", 24, 16, 20.0, 20.0, 12.0, 8.0, np.eye(3), np.zeros(3))
    view = render(scene, camera, backend=backend)
    assert float(view.alpha.abs().max()) == 0.0 and sum(view.screen.culled.values()) == 1


@given(
    sigma=arrays(np.float64, 2, elements=st.floats(0, 12)),
    angle=st.floats(-360, 360),
    margin=st.integers(0, 9),
    seed=st.integers(0, 99),
)
@QUICK
def test_any_gaussian_point_spread(sigma, angle, margin, seed):
    psf = PointSpread("gaussian", float(sigma[0]), float(sigma[1]), angle)
    try:
        blurs = [
            BlurOperator(psf, 21, 30, margin, evaluation="fourier"),
            BlurOperator(psf, 21, 30, margin, evaluation="auto"),
        ]
    except PsfError as error:
        assert error.way_out and float(np.sqrt(np.diag(psf.covariance).max())) > 10
        return
    random = torch.Generator().manual_seed(seed)
    frame, photo = (
        torch.rand(3, 21 + 2 * margin, 30 + 2 * margin, generator=random),
        torch.rand(3, 21, 30, generator=random),
    )
    for blur in blurs:
        out, back = blur.apply(frame), blur.adjoint(photo)
        assert bool(out.isfinite().all() and back.isfinite().all())
        assert float(out.min()) > -1e-5 and float(out.max()) < 1 + 1e-5
        apart = abs(float((out.double() * photo).sum() - (frame.double() * back).sum()))
        assert apart < 1e-6 * float(frame.norm() * photo.norm())
    assert float((blurs[0].apply(frame) - blurs[1].apply(frame)).abs().max()) < 1e-5


@given(values=arrays(np.float64, st.tuples(st.integers(0, 9), st.integers(0, 9)), elements=st.floats()))
@QUICK
def test_any_kernel_is_normalised_and_centred_or_refused(values):
    try:
        psf = point_spread_from_samples(values)
    except PsfError as error:
        assert error.way_out
        return
    kernel = psf.kernel()
    assert np.isfinite(kernel).all() and kernel.min() >= 0 and abs(kernel.sum() - 1) < 1e-9
    assert all(n % 2 for n in kernel.shape)


@given(
    text=st.one_of(st.text(max_size=30), st.builds("gaussian:{}".format, st.text("0123456789.,-+einfa", max_size=12)))
)
@QUICK
def test_any_text_for_a_point_spread(text):
    try:
        psf = parse_psf(text)
    except PsfError as error:
        assert error.way_out
        return
    assert psf is None or (np.isfinite(psf.covariance).all() and psf.source == text.strip())


@given(
    photo=arrays(
        np.float32,
        (3, 13, 18),
        elements=st.one_of(st.floats(0, 1, width=32), st.sampled_from([np.nan, np.inf, -np.inf, 1.0, 0.0, 1e4])),
    ),
    image=arrays(np.float32, (3, 13, 18), elements=st.floats(-1e4, 1e4, width=32)),
    weight=st.floats(0, 1),
)
@QUICK
def test_any_photo_and_any_finite_image(photo, image, weight):
    y, x = torch.from_numpy(photo), torch.from_numpy(image)
    value, slope = PhotometricLoss(y, ssim_weight=weight).value_and_gradient(x)
    assert math.isfinite(value) and value > -1e-5
    assert bool(slope.isfinite().all())
    assert float(slope[~y.isfinite()].abs().sum()) == 0.0
    assert value == pytest.approx(
        float(photometric_reference(x.double(), y.double(), ssim_weight=weight)), rel=1e-3, abs=1e-4
    )


@pytest.mark.parametrize(("backend", "count"), [("cpu", 400), ("reference", 100)])
def test_random_scenes(backend, count):
    found = fuzz(count, backend)
    assert (found.non_finite, found.uncounted) == (0, 0), found.worst
    assert len(found.culled) >= 4, "the scenes are not wild enough"
