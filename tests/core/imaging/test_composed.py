"""The blur of straight paths of motion, and convolution of kernels."""

import math

import numpy as np
import pytest
from dgs.core.errors import PsfError
from dgs.core.imaging.composed import moved
from dgs.core.imaging.kernel_samples import convolved_samples
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.psf_text import parse_psf


def turned(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors along and across."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return np.array([c, s]), np.array([-s, c])


def kernel_moments(psf: PointSpread) -> tuple[np.ndarray, np.ndarray]:
    kernel, (down, across) = psf.kernel(), psf.radius
    y, x = np.mgrid[-down : down + 1, -across : across + 1]
    place = np.stack([x.ravel(), y.ravel()])
    centre = place @ kernel.ravel()
    return centre, (place * kernel.ravel()) @ place.T - np.outer(centre, centre)


@pytest.mark.parametrize("base", ["none", "gaussian:1", "gaussian:2", "gaussian:3,1.5,20"])
@pytest.mark.parametrize(("length", "angle"), [(2.5, 0.0), (6.0, 30.0), (12.0, 100.0), (17.3, 157.0)])
def test_a_path_is_a_line_of_its_length_and_direction(base, length, angle):
    shared = parse_psf(base)
    psf = moved(shared, length, angle)
    kernel = psf.kernel()
    assert abs(kernel.sum() - 1) < 1e-12 and kernel.min() >= 0 and all(n % 2 for n in kernel.shape)
    centre, covariance = kernel_moments(psf)
    assert np.abs(centre).max() < 1e-9
    of_base = np.zeros((2, 2)) if shared is None else kernel_moments(shared)[1]
    along, across = turned(angle)
    added = covariance - of_base
    # Alone a path is antialiased by the px, 1/4 px^2 at most; a blur besides leaves its variance exact.
    slack = 0.25 if shared is None else 0.02
    assert length**2 / 12 - 0.02 <= along @ added @ along <= length**2 / 12 + slack
    assert -0.02 <= across @ added @ across <= slack
    assert psf.source.endswith(f"path:{length:g},{angle:g}")
    assert parse_psf(psf.source).kernel() == pytest.approx(kernel, abs=1e-15)


def test_a_long_path_is_even():
    """A box along its direction, not a bell."""
    row = moved(None, 21.0, 0.0).kernel().sum(axis=0)
    middle = row[len(row) // 2 - 9 : len(row) // 2 + 10]
    assert np.allclose(middle, 1 / 21, rtol=0.02)


def test_nothing_is_the_very_same():
    shared = parse_psf("gaussian:2")
    assert moved(shared, 0.0, 40.0) is shared and moved(None, 0.0, 0.0) is None
    for length in (-1.0, math.nan, 1e4):
        with pytest.raises(PsfError):
            moved(shared, length, 0.0)


def test_convolution_by_transform_is_that_by_hand():
    random = np.random.default_rng(0)
    a, b = random.random((7, 9)), random.random((9, 11))
    by_hand = sum(v * np.pad(a, ((i, 8 - i), (j, 10 - j))) for (i, j), v in np.ndenumerate(b))
    assert np.allclose(convolved_samples(a, b), by_hand) and np.allclose(
        convolved_samples(b, a[:3, :3]).sum(), b.sum() * a[:3, :3].sum()
    )


@pytest.mark.parametrize("text", ["path:", "path:3", "path:3,x", "path:-3,0", "gaussian:2+path:3", "gauss:2+path:3,0"])
def test_nonsense_is_explained(text):
    with pytest.raises(PsfError) as caught:
        parse_psf(text)
    assert caught.value.way_out


def test_photos_that_share_a_spread_share_it_on_coarser_grids():
    shared, own = parse_psf("gaussian:4"), parse_psf("gaussian:4+path:8,20")
    coarse = Medium(shared, per_view={"a": shared, "b": own, "c": own}).on_grid(2.0)
    assert coarse.psf_for("a") is coarse.psf_for("other") and coarse.psf_for("b") is coarse.psf_for("c")
    expected = (own.covariance + 3 / 12 * np.eye(2)) / 4
    assert np.allclose(coarse.psf_for("b").covariance, expected, atol=1e-6)
