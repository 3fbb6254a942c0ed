"""Kernels, spectra and filters where the right number can be written down."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from dgs.core.errors import PsfError
from dgs.core.frames import Frame
from dgs.core.imaging import choices, kernel_files
from dgs.core.imaging import operator as operator_module
from dgs.core.imaging.composed import _path, moved
from dgs.core.imaging.contradiction import CONTRADICTION, Observed
from dgs.core.imaging.evaluations import (
    REDUCED,
    Fourier,
    Reduced,
    blur_matrix,
    candidates,
    extended,
    folded,
    reduced_factors,
)
from dgs.core.imaging.formation.layered import LADDER, _variances, layer_gathered, layer_weighed, tent_of
from dgs.core.imaging.fourier import FourierFilter, _extension, _taper, wiener_photo
from dgs.core.imaging.kernel_files import read_kernel
from dgs.core.imaging.kernel_samples import convolved_samples, disc, interpolation, moments, spreading, trimmed
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator, _rounded, shared_operator
from dgs.core.imaging.psf import POINT_SPREAD, PointSpread, _centred, gaussian_taps, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.imaging.spectral_bins import SpectralBins, frequency_plane, polar_index
from dgs.core.imaging.spectrum import (
    BINS,
    HIGHEST,
    NOISE,
    OPPONENT,
    NoiseToSignal,
    _floor,
    _passed,
    _ratio,
    frequencies,
    radial_power,
)
from PIL import Image
from scipy.fft import next_fast_len

CPU = torch.device("cpu")

# --- samples -----------------------------------------------------------------------------------------------------


def test_moments_of_two_points() -> None:
    """Light 1 at (-1, 0) and 3 at (1, 1) from the middle of 3 x 5 px."""
    samples = np.zeros((3, 5))
    samples[1, 1], samples[2, 3] = 1.0, 3.0
    centroid, covariance = moments(samples)
    np.testing.assert_allclose(centroid, [0.5, 0.75])
    np.testing.assert_allclose(covariance, np.array([[4.0, 2.0], [2.0, 1.0]]) * 3 / 16)
    even = np.zeros((2, 4))
    even[0, 0] = 2.0
    np.testing.assert_allclose(moments(even)[0], [-1.5, -0.5])


@pytest.mark.parametrize(
    ("t", "share"), [(0.0, 1.0), (0.5, 0.5625), (1.0, 0.0), (1.5, -0.0625), (2.0, 0.0), (2.5, 0.0)]
)
def test_keys_cubic_and_the_hat(t: float, share: float) -> None:
    assert spreading(np.array([t]))[0] == pytest.approx(share, abs=1e-15)
    assert spreading(np.array([t]), linear=True)[0] == max(0.0, 1.0 - t)


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize(("size", "s", "offset"), [(7, 1.0, 0.3), (6, 1.0, 0.0), (9, 2.5, 0.0), (8, 1.7, -0.6)])
def test_resampling_keeps_light_and_centre(linear: bool, size: int, s: float, offset: float) -> None:
    matrix = interpolation(size, s, offset, linear)
    assert len(matrix) % 2 == 1
    np.testing.assert_allclose(matrix.sum(axis=0), 1.0, atol=1e-12)
    place = np.arange(len(matrix)) - len(matrix) // 2
    np.testing.assert_allclose(place @ matrix, (np.arange(size) - (size - 1) / 2 - offset) / s, atol=1e-12)
    assert np.abs(matrix[0]).max() > 0 or np.abs(matrix[-1]).max() > 0 or len(matrix) <= size / s + 4, "no px too many"
    if not linear:  # each tap's light keeps a variance of nothing
        np.testing.assert_allclose(place**2 @ matrix, (place @ matrix) ** 2, atol=1e-12)


def test_borders_without_light_are_cut_on_both_sides_alike() -> None:
    samples = np.zeros((11, 9))
    samples[3:8, 3:6] = 1.0
    samples[2, 4] = 1e-8
    found = trimmed(samples * 2.0)
    assert found.shape == (5, 3) and found.sum() == pytest.approx(1.0)
    samples = np.zeros((5, 5))
    samples[2, 2], samples[0, 2] = 1.0, 1e-6
    assert trimmed(samples).shape == (5, 1), "a millionth is kept, and the other side with it"
    samples[0, 2] = 1e-7
    assert trimmed(samples).shape == (1, 1)


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.5, 1.0, 3.0, 7.4])
def test_a_disc_has_a_discs_variance(radius: float) -> None:
    """r^2 / 4 along either axis, and a px' own 1 / 12."""
    kernel = disc(radius)
    assert kernel.sum() == pytest.approx(1.0) and kernel.shape == (2 * math.ceil(radius) * (radius > 0.1) + 1,) * 2
    centroid, covariance = moments(kernel)
    np.testing.assert_allclose(centroid, 0.0, atol=1e-12)
    if radius >= 3.0:
        np.testing.assert_allclose(np.diag(covariance), radius**2 / 4 + 1 / 12, rtol=0.02)
        reach = math.ceil(radius)
        assert kernel[reach, reach] == pytest.approx(1 / (math.pi * radius**2), rel=0.02)


@pytest.mark.parametrize("size", [3, 8, 9])  # by hand up to 64 px, by transform beyond
def test_convolution_of_two_points_is_a_point(size: int) -> None:
    a, b = np.zeros((4, 5)), np.zeros((size, size))
    a[1, 2], b[2, 1] = 2.0, 3.0
    out = convolved_samples(a, b)
    assert out.shape == (3 + size, 4 + size)
    expected = np.zeros_like(out)
    expected[3, 3] = 6.0
    np.testing.assert_allclose(out, expected, atol=1e-12)


# --- point spreads -----------------------------------------------------------------------------------------------


def test_taps_by_their_formula() -> None:
    taps = gaussian_taps(1.0)
    assert len(taps) == 9
    np.testing.assert_allclose(taps / taps[4], np.exp(-0.5 * np.arange(-4, 5) ** 2), rtol=1e-12)
    assert len(gaussian_taps(1.1)) == 11 and len(gaussian_taps(0.25)) == 3 and gaussian_taps(0.0).tolist() == [1.0]
    assert len(gaussian_taps(1.0, 6.0)) == 13


def test_a_tilted_kernel_by_its_formula() -> None:
    psf = PointSpread(sigma_x=3.0, sigma_y=1.0, angle=30.0)
    kernel = psf.kernel()
    (a, b), (_, c) = np.linalg.inv(psf.covariance)
    rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
    assert (rows, columns) == psf.radius
    assert rows == math.ceil(4 * math.sqrt(psf.covariance[1, 1])) and columns == math.ceil(
        4 * psf.covariance[0, 0] ** 0.5
    )
    for x, y in ((1, 0), (0, 1), (2, 1), (-2, 1), (3, 2)):
        expected = math.exp(-0.5 * (a * x * x + 2 * b * x * y + c * y * y))
        assert kernel[rows + y, columns + x] / kernel[rows, columns] == pytest.approx(expected)
    assert np.abs(np.rad2deg(np.arctan2(*np.linalg.eigh(psf.covariance)[1][::-1, 1])) % 180 - 30.0) < 1e-9
    thin = PointSpread(sigma_x=3.0, sigma_y=0.0, angle=30.0)  # would slip between px
    assert moments(thin.kernel())[1].min() > 0 and np.isfinite(thin.kernel()).all()


@pytest.mark.parametrize("turn", [0.0, 180.0, 90.0, 270.0, -90.0])
def test_right_angles_are_separable(turn: float) -> None:
    psf = PointSpread(sigma_x=2.0, sigma_y=1.0, angle=turn)
    found = psf.separable()
    assert found is not None
    upright = turn % 180.0 == 90.0
    assert [len(taps) for taps in found] == ([17, 9] if upright else [9, 17])
    np.testing.assert_allclose(np.diag(psf.covariance), [1.0, 4.0] if upright else [4.0, 1.0], atol=1e-12)


def test_samples_of_rank_one_are_separable_and_others_not() -> None:
    outer = np.outer([1.0, 2.0, 1.0], [1.0, 3.0, 1.0])
    psf = point_spread_from_samples(outer)
    vertical, horizontal = psf.separable() or (None, None)
    np.testing.assert_allclose(vertical, [0.25, 0.5, 0.25])
    np.testing.assert_allclose(horizontal, [0.2, 0.6, 0.2])
    cross = np.array([[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]])
    assert point_spread_from_samples(cross).separable() is None
    assert PointSpread("file", samples=np.ones((1, 1))).is_identity
    assert not PointSpread("file", samples=np.ones((1, 3)) / 3).is_identity
    assert PointSpread().is_identity and not PointSpread(sigma_y=1e-9).is_identity


@pytest.mark.parametrize("s", [2.0, 3.0])
@pytest.mark.parametrize("low_pass", [0.0, 0.3])
def test_coarse_samples_have_the_variance_that_the_law_says(s: float, low_pass: float) -> None:
    """(sigma^2 + (s^2 - 1) (1/12 - l)) / s^2, for samples by three taps."""
    sampled = point_spread_from_samples(PointSpread(sigma_x=4.0, sigma_y=5.0).kernel())
    covariance = sampled.on_grid(s, low_pass).covariance
    expected = (np.diag(sampled.covariance) + (s * s - 1) * (1 / 12 - low_pass)) / s**2
    np.testing.assert_allclose(np.diag(covariance), expected, rtol=3e-3)
    with pytest.raises(ValueError, match="s >= 1"):
        sampled.on_grid(0.5)
    assert PointSpread(sigma_x=0.1).on_grid(2.0, 1.0).sigma_x == 0.0, "no less than nothing"


def test_contrast_of_samples_is_their_fourier_transform() -> None:
    psf = PointSpread("file", samples=np.array([[0.0, 0.0, 0.0], [0.25, 0.5, 0.25], [0.0, 0.0, 0.0]]))
    f = np.array([0.0, 0.1, 0.25, 0.5])
    np.testing.assert_allclose(psf.mtf(f), 0.5 + 0.5 * np.cos(2 * np.pi * f), atol=1e-12)
    np.testing.assert_allclose(psf.mtf(f, 90.0), 1.0, atol=1e-12)
    np.testing.assert_allclose(psf.mtf(f, 60.0), 0.5 + 0.5 * np.cos(np.pi * f), atol=1e-12)
    tilted = PointSpread(sigma_x=2.0, sigma_y=1.0, angle=30.0)
    np.testing.assert_allclose(tilted.mtf(f, 30.0), np.exp(-2 * np.pi**2 * 4.0 * f**2), atol=1e-12)
    np.testing.assert_allclose(tilted.mtf(f, 120.0), np.exp(-2 * np.pi**2 * f**2), atol=1e-12)


def test_the_shortest_pattern_that_is_left() -> None:
    """exp(-2 pi^2 s^2 f^2) = noise; steps of 1/1024 cycles/px, the last above the noise."""
    for noise in (0.5, 0.1, 0.01):
        f = math.sqrt(-math.log(noise) / (2 * math.pi**2 * 9.0))
        step = math.floor(f * 1024) / 1024
        assert PointSpread(sigma_x=3.0, sigma_y=1.0).resolvable_period(noise) == pytest.approx(1 / step, rel=1e-9)
    assert PointSpread(sigma_x=900.0, sigma_y=900.0).resolvable_period(0.5) == 1024.0


@pytest.mark.parametrize(("offset", "refused"), [(1.4, False), (3.0, True)])
def test_how_far_off_its_middle_a_kernel_may_be(offset: float, refused: bool) -> None:
    """A quarter of its size, or one px."""
    y, x = np.mgrid[-5:6, -5:6]
    values = np.exp(-((x - offset) ** 2 + y**2) / 2)
    if refused:
        with pytest.raises(PsfError, match=r"centroid 2\.8 px off|centroid 2\.9 px off|centroid 3\.0 px off"):
            point_spread_from_samples(values)
    else:
        psf = point_spread_from_samples(values)
        np.testing.assert_allclose(moments(psf.kernel())[0], 0.0, atol=1e-6)
        assert any(re.search(r"by \(-1\.(39|40)\d, [+-]0\.000\) px", note) for note in psf.notes)


def test_the_largest_kernel_and_the_sum_that_counts_as_one() -> None:
    side = POINT_SPREAD.longest_side
    line = np.zeros((side, 1))
    line[side // 2] = 1.0
    assert point_spread_from_samples(line).notes == ()
    with pytest.raises(PsfError):
        point_spread_from_samples(np.pad(line, ((1, 1), (0, 0))))
    point = np.zeros((3, 3))
    point[1, 1] = 1.0
    assert point_spread_from_samples(point * 1.0009).notes == ()
    assert len(point_spread_from_samples(point * 1.0011).notes) == 1
    assert len(point_spread_from_samples(point * 0.9989).notes) == 1


@pytest.mark.parametrize(
    ("text", "sigmas"),
    [("gaussian:5,0", (5.0, 0.0, 0.0)), ("gaussian:1000", (1000.0, 1000.0, 0.0)), (" gaussian:2 ", (2.0, 2.0, 0.0))],
)
def test_the_ends_of_what_a_text_may_say(text: str, sigmas: tuple[float, float, float]) -> None:
    psf = parse_psf(text)
    assert psf is not None and (psf.sigma_x, psf.sigma_y, psf.angle) == sigmas and psf.source == text.strip()
    for wrong in ("gaussian:1000.1", "gaussian:2,-1", "gaussian:inf", "+".join(["path:3,0"] * 9), "x" * 5001):
        with pytest.raises(PsfError):
            parse_psf(wrong)
    eight = parse_psf("+".join(["path:3,0"] * 8))
    assert eight is not None and eight.covariance[0, 0] == pytest.approx(8 * 9 / 12, abs=0.3)


# --- composed ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("length", "angle"), [(10.0, 0.0), (10.0, 90.0), (7.0, 45.0), (512.0, 0.0)])
def test_a_paths_extent_is_its_length(length: float, angle: float) -> None:
    psf = moved(None, length, angle)
    assert psf is not None
    across = abs(length * math.cos(math.radians(angle)))
    down = abs(length * math.sin(math.radians(angle)))
    rows, columns = psf.kernel().shape
    assert columns == pytest.approx(across, abs=3) and rows == pytest.approx(down, abs=3)
    np.testing.assert_allclose(moments(psf.kernel())[0], 0.0, atol=1e-9)
    with pytest.raises(PsfError):
        moved(None, 512.1, 0.0)


# --- media -------------------------------------------------------------------------------------------------------


def test_photos_that_were_shrunk_by_different_factors() -> None:
    shared, own = parse_psf("gaussian:4"), parse_psf("gaussian:2")
    medium = Medium(shared, per_view={"b": own})
    same = medium.at_scales({"a": 1.0, "b": 1.0})
    assert same is medium
    half = medium.at_scales({"a": 0.5, "b": 0.5})
    assert half.psf is not None and half.psf.sigma_x == pytest.approx(math.sqrt(16 + 0.25) / 2)
    mixed = medium.at_scales({"a": 0.5, "b": 1.0, "c": 1.0})
    assert mixed.psf_for("b") is own and mixed.psf_for("c") is shared
    assert mixed.psf is not None and mixed.psf.sigma_x == half.psf.sigma_x, "the first photo's"


# --- evaluations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("vertical", "horizontal"), [(2, 1), (-1, 2), (0, 3), (-2, -1), (0, 0), (1, 0)])
def test_extension_repeats_the_edge_and_its_transpose_folds_back(vertical: int, horizontal: int) -> None:
    x = torch.arange(60, dtype=torch.float64).reshape(1, 6, 10)
    out = extended(x, vertical, horizontal)
    rows = np.clip(np.arange(-vertical, 6 + vertical), 0, 5)
    columns = np.clip(np.arange(-horizontal, 10 + horizontal), 0, 9)
    np.testing.assert_array_equal(out[0], x[0][rows][:, columns])
    random = torch.Generator().manual_seed(0)
    a, b = (torch.rand(shape, generator=random, dtype=torch.float64) for shape in (x.shape, out.shape))
    assert (extended(a, vertical, horizontal) * b).sum() == pytest.approx(
        float((a * folded(b, vertical, horizontal)).sum())
    )


def test_one_axis_as_a_matrix() -> None:
    matrix = blur_matrix(np.array([0.25, 0.5, 0.25]), 3, 1)
    np.testing.assert_allclose(matrix, [[0.25, 0.5, 0.25, 0, 0], [0, 0.25, 0.5, 0.25, 0], [0, 0, 0.25, 0.5, 0.25]])
    edge = blur_matrix(np.array([0.25, 0.5, 0.25]), 2, 0)
    np.testing.assert_allclose(edge, [[0.75, 0.25], [0.25, 0.75]])


@pytest.mark.parametrize(("sigma", "inside", "margin"), [(4.0, 50, 0), (4.0, 50, 9), (20.0, 64, 30)])
def test_the_reduced_blur_is_within_its_bound(sigma: float, inside: int, margin: int) -> None:
    down, up, bound = reduced_factors(sigma, inside, margin)
    exact = blur_matrix(gaussian_taps(sigma, REDUCED.reference_reach), inside, margin)
    assert bound == pytest.approx(0.5 * np.abs(up @ down - exact).sum(axis=1).max()) and bound < 5e-5
    np.testing.assert_allclose(up.sum(axis=1), 1.0)
    np.testing.assert_allclose(down.sum(axis=1), 1.0)
    assert up.shape == (inside, len(down)) and down.shape[1] == inside + 2 * margin
    assert len(down) == math.ceil((inside + 2 * REDUCED.reach * sigma / 2**0.5) / (REDUCED.step * sigma)) + 1
    worst = np.sign(up @ down - exact)[np.abs(up @ down - exact).sum(axis=1).argmax()] / 2 + 0.5
    assert np.abs((up @ down - exact) @ worst).max() == pytest.approx(bound, rel=1e-6), "reached by a frame in [0, 1]"


def test_which_evaluations_fit() -> None:
    frame = Frame(40, 60, 4)
    offered = lambda psf: set(candidates(psf, frame, torch.float32, CPU))  # noqa: E731
    assert offered(PointSpread(sigma_x=2.0, sigma_y=2.0)) == {"fourier", "direct", "separable", "reduced"}
    assert "reduced" not in offered(PointSpread(sigma_x=1.9, sigma_y=3.0))
    assert "separable" not in offered(PointSpread(sigma_x=4.0, sigma_y=2.0, angle=20.0))
    lopsided = PointSpread("file", samples=np.array([[0.1, 0.5, 0.4]]))
    assert "separable" not in offered(lopsided) and "fourier" in offered(lopsided)
    upright = candidates(PointSpread(sigma_x=5.0, sigma_y=2.5, angle=90.0), frame, torch.float64, CPU)
    picture = torch.rand((1, 48, 68), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for name in ("reduced", "separable"):
        torch.testing.assert_close(upright[name].apply(picture), upright["fourier"].apply(picture), atol=3e-4, rtol=0)


@pytest.mark.parametrize("margin", [0, 2, 9])
def test_fourier_blurs_a_point_to_its_kernel(margin: int) -> None:
    kernel = np.random.default_rng(0).random((5, 7))
    kernel /= kernel.sum()
    blur = Fourier(kernel, Frame(21, 30, margin), torch.float64, CPU)
    picture = torch.zeros((1, 21 + 2 * margin, 30 + 2 * margin), dtype=torch.float64)
    picture[0, 10 + margin, 15 + margin] = 1.0
    out = blur.apply(picture)[0].numpy()
    expected = np.zeros((21, 30))
    expected[8:13, 12:19] = kernel
    np.testing.assert_allclose(out, expected, atol=1e-12)
    assert blur.adjoint(torch.ones((1, 21, 30), dtype=torch.float64)).shape == picture.shape


def test_no_blur_crops_the_margin_and_its_transpose_pads() -> None:
    operator = BlurOperator(None, 4, 6, 2)
    picture = torch.rand((3, 8, 10))
    assert operator.evaluation == "identity"
    assert torch.equal(operator.apply(picture), picture[:, 2:6, 2:8])
    back = operator.adjoint(picture[:, 2:6, 2:8])
    assert back.shape == (3, 8, 10) and torch.equal(back[:, 2:6, 2:8], picture[:, 2:6, 2:8])
    assert float(back.sum()) == pytest.approx(float(picture[:, 2:6, 2:8].sum()), rel=1e-6)
    whole = BlurOperator(PointSpread(), 4, 6)
    assert whole.apply(picture[:, :4, :6]).data_ptr() == picture.data_ptr()
    for wrong in (picture[:, :4], picture[0], picture[:, :, :9]):
        with pytest.raises(ValueError, match="expected"):
            operator.apply(wrong)
    with pytest.raises(ValueError, match="expected"):
        operator.adjoint(picture)


@pytest.mark.parametrize(("sigma", "refused"), [(19.9, False), (20.1, True)])
def test_a_blur_as_wide_as_half_the_photo_is_refused(sigma: float, refused: bool) -> None:
    for psf in (PointSpread(sigma_x=sigma, sigma_y=1.0), PointSpread(sigma_x=1.0, sigma_y=sigma)):
        if refused:
            with pytest.raises(PsfError, match=r"standard deviation of 20\.1 px"):
                BlurOperator(psf, 40, 60, evaluation="fourier")
        else:
            assert BlurOperator(psf, 40, 60, evaluation="fourier").evaluation == "fourier"
    with pytest.raises(PsfError, match="does not fit"):
        BlurOperator(PointSpread(sigma_x=1.0, sigma_y=1.0), 40, 60, evaluation="reduced")


def test_operators_are_shared_by_their_kernel() -> None:
    a = shared_operator(PointSpread(sigma_x=2.0, sigma_y=2.0, source="one"), 40, 50, 3)
    assert a is shared_operator(PointSpread(sigma_x=2.0, sigma_y=2.0, source="other"), 40, 50, 3)
    assert a is not shared_operator(PointSpread(sigma_x=2.0, sigma_y=2.1), 40, 50, 3)
    assert a is not shared_operator(PointSpread(sigma_x=2.0, sigma_y=2.0), 40, 50)
    assert shared_operator(None, 40, 50).evaluation == "identity"
    assert [_rounded(n) for n in (1, 8, 9, 16, 17)] == [8, 8, 16, 16, 24]


# --- which one was fastest ---------------------------------------------------------------------------------------


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(choices, "_chosen", {})
    return tmp_path / "dgs" / "evaluations.json"


def test_a_choice_is_measured_once_and_kept(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def measured(name: str) -> str:
        return choices.choice(b"kernel", 40, names=["a", "b"], measure=lambda: asked.append(1) or name)  # type: ignore[func-returns-value]

    assert measured("b") == "b" and measured("a") == "b" and len(asked) == 1
    monkeypatch.setattr(choices, "_chosen", {})  # another process
    assert measured("a") == "b" and len(asked) == 1
    assert choices.choice(b"other", 40, names=["a", "b"], measure=lambda: "a") == "a"
    assert choices.choice(b"kernel", 41, names=["a", "b"], measure=lambda: "a") == "a"
    assert choices.choice(b"kernel", 40, names=["a", "c"], measure=lambda: "c") == "c"
    assert sorted(json.loads(own_cache.read_text("utf-8")).values()) == ["a", "a", "b", "c"]
    (key,) = [k for k, v in json.loads(own_cache.read_text("utf-8")).items() if v == "b"]
    for damaged in ("{", "[]", json.dumps({key: "z"})):
        own_cache.write_text(damaged)
        monkeypatch.setattr(choices, "_chosen", {})
        assert measured("a") == "a", "a name that is not offered, or a file that was cut off: measured again"
    assert [path.name for path in own_cache.parent.iterdir()] == ["evaluations.json"]


def test_a_choice_that_cannot_be_kept_still_counts(own_cache: Path) -> None:
    own_cache.mkdir(parents=True)
    assert choices.choice(b"kernel", names=["a"], measure=lambda: "a") == "a"


# --- spectra -----------------------------------------------------------------------------------------------------


def test_the_axes_of_colours_are_orthonormal() -> None:
    np.testing.assert_allclose(OPPONENT @ OPPONENT.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(OPPONENT @ [1, 1, 1], [3**0.5, 0, 0], atol=1e-12)
    assert frequencies()[0] == 0 and frequencies()[-1] == pytest.approx(0.5**0.5) and len(frequencies()) == 96


def test_bins_of_frequency_by_ring_and_direction() -> None:
    edges = np.array([0.1, 0.2, 0.4])
    index = polar_index(40, 40, edges, 4)
    fy, fx = frequency_plane(40, 40)
    assert fy.shape == (40, 1) and fx.shape == (1, 21) and fx[0, 1] == 1 / 40 and fy[-1, 0] == -1 / 40
    assert index[0, 0] == -1 and index[0, 3] == -1 and index[0, 20] == -1  # 0, 0.075 and 0.5
    assert index[0, 5] == 0 and index[0, 10] == 4  # along x: ring 0 and 1
    assert index[6, 0] == 2 and index[4, 4] == 1 and index[-4, 4] == 3  # down, and the two diagonals
    assert index[0, 4] == 0 and index[0, 8] == 4 and index[0, 16] == -1, "a ring begins at its edge, and ends before"


def test_a_wave_has_its_power_in_its_bin() -> None:
    size = 64
    index = np.minimum(np.rint(np.hypot(*frequency_plane(size, size)) * size).astype(int), 40)
    bins = SpectralBins((size, size), index, 41)
    assert bins.window.shape == (size, size) and bins.window.min() > 0 and bins.counts.sum() == index.size
    np.testing.assert_allclose(bins.window, np.flip(bins.window), atol=1e-12)
    wave = 0.3 + 0.2 * np.cos(2 * np.pi * 10 * np.arange(size) / size)[None, :].repeat(size, axis=0)
    power = bins.power_of(wave)
    assert power[8:13].sum() > 0.999 * power.sum() and power.argmax() == 10
    np.testing.assert_allclose(bins.power_of(wave + 5.0), power, atol=1e-12)
    np.testing.assert_allclose(bins.mean_power((3 * (wave - wave.mean()))[None])[0].sum(), 9 * power.sum(), rtol=1e-2)
    left_out = SpectralBins((size, size), np.where(index == 10, -1, index), 41)
    assert left_out.counts[10] == 0 and left_out.power_of(wave)[10] == 0


def test_small_frames_leave_no_gap_in_the_table() -> None:
    planes = np.random.default_rng(0).normal(size=(1, 12, 14)).astype(np.float32)
    power = radial_power(planes)
    assert power.shape == (1, BINS) and (power[:, 1:] > 0).all()
    h, w = frequency_plane(12, 14)
    used = set(np.rint(np.hypot(h, w) / HIGHEST * (BINS - 1)).astype(int).ravel())
    gaps = [i for i in range(1, BINS) if i not in used]
    assert gaps and all(power[0, i] == power[0, i - 1] for i in gaps)


def test_what_contradicts_is_trusted_no_more() -> None:
    table = np.full(BINS, 0.5)
    unexplained = np.stack([np.full(BINS, 2.0), np.full(BINS, 3.0)])
    found = NoiseToSignal(table, table, 0.01, excess=9.0, unexplained=unexplained).trusted(10.0)
    np.testing.assert_allclose(found.brightness, 2.05)
    np.testing.assert_allclose(found.colour, 3.05)
    assert found.unexplained is None and found.contradicted
    limit = CONTRADICTION.limit
    assert not NoiseToSignal(table, table, 0.0, excess=limit).contradicted
    assert NOISE.least_ratio < NOISE.most_ratio


def observed(width: float = 4.0, true: float = 4.0, floor: float = 1e-6, slope: float = 2.0) -> Observed:
    """A scene of power 1e-4 f^-slope through a Gaussian of `true` px, said to be of `width` px."""
    f = np.maximum(frequencies(), 1e-4)
    transfer = lambda sigma: np.exp(-2 * np.pi**2 * sigma**2 * f**2)  # noqa: E731
    return Observed(1e-4 * f**-slope * transfer(true) ** 2 + floor, floor, transfer(width), f)


@pytest.mark.parametrize("slope", [0.5, 2.0, 3.5])
def test_a_scenes_power_law_is_read_where_the_blur_lets_it_pass(slope: float) -> None:
    seen = observed(slope=slope, floor=1e-9)
    scene = seen.scene()
    assert scene is not None
    np.testing.assert_allclose(scene[1:], 1e-4 * seen.f[1:] ** -slope, rtol=1e-3)
    assert scene[0] == pytest.approx(scene[1]), "no infinity at no frequency"
    assert seen.excess() == pytest.approx(1.0, abs=1e-3)
    assert seen.widest() == 1.0 and not seen.unexplained().any()
    assert not seen.clear[seen.f <= CONTRADICTION.lowest].any()
    assert (seen.transfer[seen.fine] ** 2 < CONTRADICTION.passing).all()


def test_a_blur_that_was_given_too_wide_leaves_what_it_cannot_explain() -> None:
    seen = observed(width=5.0, true=4.0)
    scene = seen.scene()
    assert scene is not None
    explained = seen.transfer**2 * scene + seen.floor
    assert seen.excess() == pytest.approx(float((seen.power / explained)[seen.fine].max()))
    assert seen.excess() > CONTRADICTION.limit
    over = np.where(seen.fine, np.maximum(seen.power - 1.3 * explained, 0) * 20.0 / scene, 0.0)
    np.testing.assert_allclose(seen.unexplained(), np.maximum.accumulate(over))
    assert 0.8 <= seen.widest() < 0.9, "as far as an excess of two is none"
    nothing = observed(floor=1e9)
    assert nothing.scene() is None and nothing.excess() == 1.0 and not nothing.unexplained().any()


# --- filters -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["newton", "wiener"])
def test_a_filters_gain_is_that_of_its_formula(kind: str) -> None:
    """|H|^2 / (|H|^2 + n) and conj(H) / (|H|^2 + n), on waves that fit the frame."""
    psf = PointSpread(sigma_x=1.5, sigma_y=1.5)
    filter_ = FourierFilter(psf, (60, 60), 0.01, kind, dtype=torch.float64)  # type: ignore[arg-type]
    rows, columns = filter_.size
    for i, j in ((0, 0), (3, 0), (0, 5), (4, 4)):
        f = i / rows, j / columns
        h = float(psf.mtf(math.hypot(*f)))
        expected = h**2 / (h**2 + 0.01) if kind == "newton" else h / (h**2 + 0.01)
        assert complex(filter_.transfer[i, j]) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("values", [-1.0, 0.0, math.nan, [1.0, 0.0], [[[1.0]]]])
def test_noise_that_is_none_is_refused(values: object) -> None:
    with pytest.raises(ValueError, match="positive"):
        FourierFilter(PointSpread(sigma_x=1.0, sigma_y=1.0), (20, 20), values)  # type: ignore[arg-type]


def test_noise_over_frequency_and_by_channel() -> None:
    psf = PointSpread(sigma_x=1.0, sigma_y=1.0)
    steps = np.linspace(0, math.sqrt(0.5), 30)
    rising = FourierFilter(psf, (40, 40), 0.01 + steps, dtype=torch.float64)
    rows, columns = rising.size
    h = float(psf.mtf(5 / rows))
    assert float(rising.transfer[5, 0]) == pytest.approx(h**2 / (h**2 + 0.01 + 5 / rows), abs=2e-4)
    three = FourierFilter(psf, (40, 40), np.stack([0.01 + steps, 1 + 0 * steps, 2 + 0 * steps]), dtype=torch.float64)
    assert three.transfer.shape[0] == 3
    torch.testing.assert_close(three.transfer[0], rising.transfer)
    picture = torch.rand((3, 40, 40), dtype=torch.float64)
    torch.testing.assert_close(three.apply(picture)[0], rising.apply(picture)[0])
    assert three.size == (rows, columns)


def test_a_photo_of_one_colour_stays_as_it_is() -> None:
    """H is 1 at no frequency; what lies beyond is reflected and tapered to the mean."""
    grey = torch.full((3, 37, 53), 0.4)
    out = wiener_photo(grey, PointSpread(sigma_x=3.0, sigma_y=2.0), 1e-5)
    torch.testing.assert_close(out, grey, atol=1e-4, rtol=0)
    assert wiener_photo(grey, PointSpread(), 1e-5) is grey
    wide = FourierFilter(PointSpread(sigma_x=3.0, sigma_y=2.0), (37, 53), 1e-3, "wiener", "reflect")
    with pytest.raises(ValueError, match="adjoint"):
        wide.adjoint(grey)
    narrow = wiener_photo(torch.rand((3, 5, 6)), PointSpread(sigma_x=2.0, sigma_y=2.0), 1e-2)
    assert narrow.shape == (3, 5, 6) and bool(torch.isfinite(narrow).all())


# --- files of kernels --------------------------------------------------------------------------------------------


def fits(cards: dict[str, object], data: bytes) -> bytes:
    header = "".join(f"{k:<8}= {v!s:>20}".ljust(80) for k, v in cards.items()) + "END".ljust(80)
    return header.ljust(-(-len(header) // 2880) * 2880).encode() + data


@pytest.mark.parametrize(
    ("bits", "kind"), [(8, ">u1"), (16, ">i2"), (32, ">i4"), (64, ">i8"), (-32, ">f4"), (-64, ">f8")]
)
def test_fits_of_every_type(bits: int, kind: str, tmp_path: Path) -> None:
    values = np.arange(6).reshape(2, 3).astype(kind)
    cards = {"SIMPLE": "T", "BITPIX": bits, "NAXIS": 2, "NAXIS1": 3, "NAXIS2": 2, "BSCALE": "2.0D0", "BZERO": "1.0E0"}
    (tmp_path / "a.fits").write_bytes(fits(cards, values.tobytes()))
    np.testing.assert_array_equal(read_kernel(tmp_path / "a.fits"), values.astype(float) * 2 + 1)
    del cards["BSCALE"], cards["BZERO"]
    padding = {f"X{i}": i for i in range(40)}  # a header of two blocks
    (tmp_path / "a.FIT").write_bytes(fits(cards | padding, values.tobytes()))
    np.testing.assert_array_equal(read_kernel(tmp_path / "a.FIT"), values.astype(float))


@pytest.mark.parametrize(
    "change", [{"SIMPLE": "F"}, {"NAXIS": 0}, {"NAXIS1": -3}, {"NAXIS1": 4}, {"BITPIX": 7}, {"NAXIS2": 0}]
)
def test_fits_that_hold_no_array(change: dict[str, object], tmp_path: Path) -> None:
    cards: dict[str, object] = {"SIMPLE": "T", "BITPIX": 8, "NAXIS": 2, "NAXIS1": 3, "NAXIS2": 2}
    (tmp_path / "a.fts").write_bytes(fits(cards | change, bytes(6)))
    with pytest.raises(PsfError, match=r"a\.fts"):
        read_kernel(tmp_path / "a.fts")


def test_channels_of_a_kernel(tmp_path: Path) -> None:
    grey = np.random.default_rng(0).random((4, 5))
    for channels, alpha in ((2, 1), (3, 0), (4, 1)):
        values = np.stack([grey] * (channels - alpha) + [np.ones((4, 5))] * alpha, axis=2)
        np.save(tmp_path / "a.npy", values)
        np.testing.assert_array_equal(read_kernel(tmp_path / "a.npy"), grey)
    values = np.stack([grey, grey, grey * (1 + 1e-5)], axis=2)
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(PsfError, match="coloured"):
        read_kernel(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.ones((3, 4, 5)))
    with pytest.raises(PsfError, match="shape"):
        read_kernel(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.ones((1, 4, 5)))
    assert read_kernel(tmp_path / "a.npy").shape == (4, 5)
    np.save(tmp_path / "a.npy", np.arange(5))
    assert read_kernel(tmp_path / "a.npy").shape == (1, 5)
    np.save(tmp_path / "a.npy", np.ones((3, 3), complex))
    with pytest.raises(PsfError, match="complex"):
        read_kernel(tmp_path / "a.npy")


def test_reduced_is_two_narrower_blurs() -> None:
    reduced = Reduced(6.0, 8.0, Frame(40, 50, 5), torch.float64, CPU)
    assert reduced.bound == pytest.approx(reduced_factors(6.0, 40, 5)[2] + reduced_factors(8.0, 50, 5)[2])
    random = torch.Generator().manual_seed(0)
    a = torch.rand((2, 50, 60), generator=random, dtype=torch.float64)
    b = torch.rand((2, 40, 50), generator=random, dtype=torch.float64)
    assert float((reduced.apply(a) * b).sum()) == pytest.approx(float((a * reduced.adjoint(b)).sum()))


@pytest.mark.parametrize(("name", "size"), [("k.png", 9 * 7 * 4), ("k.tif", 9 * 7 * 8)])
def test_a_picture_is_refused_by_the_memory_that_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, size: int
) -> None:
    """Four bytes for each px of a PNG, eight for each of a TIFF file, whatever they hold."""
    values, checked = np.arange(63, dtype=np.uint8).reshape(7, 9), []
    if name == "k.png":
        Image.fromarray(values).save(tmp_path / name)
    else:
        tifffile.imwrite(tmp_path / name, values)
    usual = kernel_files._check_size
    monkeypatch.setattr(kernel_files, "_check_size", lambda asked: checked.append(asked) or usual(asked))
    np.testing.assert_array_equal(read_kernel(tmp_path / name), values)
    assert checked == [size]
    limit = kernel_files._LARGEST_FILE
    usual(limit)
    with pytest.raises(ValueError, match="256 MiB"):
        usual(limit + 1)


def test_a_frame_fades_to_the_middle_of_the_periodic_grid() -> None:
    """Ten px, two of them the frame's: the others by how far they are from it, either way round."""
    far = np.array([3, 2, 1, 0, 0, 1, 2, 3, 4, 4])
    np.testing.assert_allclose(_taper((10, 1), (3, 0), 2, 1)[:, 0], np.cos(np.pi / 2 * far / 4) ** 2, atol=1e-12)
    wanted = np.cos(np.pi / 2 * np.array([0, 0, 0, 1, 2, 1]) / 1.5).clip(min=0) ** 2
    np.testing.assert_allclose(_taper((1, 6), (0, 0), 1, 3)[0], wanted, atol=1e-12)


def test_frames_are_extended_by_one_and_a_half_radii() -> None:
    for psf in (PointSpread(sigma_x=2.0, sigma_y=5.0), PointSpread(sigma_x=4.0, sigma_y=1.0)):
        assert _extension(psf) == tuple(math.ceil(1.5 * radius) for radius in psf.radius)


def test_the_direction_of_the_axes_counts_among_those_that_are_asked() -> None:
    """The blur is widest along x, to the very angle: one degree aside a pattern more would be resolved."""
    psf = PointSpread(sigma_x=4.0, sigma_y=1.0)
    frequency = np.linspace(0.0, 0.5, 513)[100]
    noise = float(psf.mtf(np.array([frequency]), 0.0)[0]) * (1 + 1e-5)
    assert psf.resolvable_period(noise) == pytest.approx(1 / np.linspace(0.0, 0.5, 513)[99], rel=1e-12)


def test_a_point_whose_interpolation_undershoots_is_moved_linearly() -> None:
    """Three quarters of a px: (3, 1) / 4 becomes (0.75, 2.5, 0.75) / 4; a cubic would fall below nothing."""
    samples = np.zeros((7, 7))
    samples[3, 2:4] = 0.75, 0.25
    psf = _centred(samples, "test")[0]
    row = psf[psf.shape[0] // 2]
    middle = len(row) // 2
    np.testing.assert_allclose(row[middle - 1 : middle + 2], [0.1875, 0.625, 0.1875], atol=1e-12)
    assert psf.sum() == pytest.approx(1.0) and row[: middle - 1].max(initial=0.0) < 1e-12


def test_the_mean_width_of_a_medium() -> None:
    """Root mean square over directions and photos; a photo without a blur counts with none; a blur lies along x, y."""
    wide = PointSpread(sigma_x=6.0, sigma_y=2.0)
    np.testing.assert_allclose(wide.covariance, [[36.0, 0.0], [0.0, 4.0]], atol=1e-12)
    assert Medium(wide).mean_sigma(["a"]) == pytest.approx(math.sqrt(20.0))
    assert Medium(wide, per_view={"b": None}).mean_sigma(["a", "b"]) == pytest.approx(math.sqrt(10.0))
    assert Medium(None).mean_sigma(["a", "b"]) == 0.0


@pytest.mark.parametrize(("inside", "margin"), [(20, 3), (21, 0)])
def test_the_coarse_grid_lies_evenly_about_the_middle(inside: int, margin: int) -> None:
    """A mirrored frame has a mirrored blur, on the coarse grid, too."""
    down, up, _ = reduced_factors(4.0, inside, margin)
    np.testing.assert_allclose(down, down[::-1, ::-1], atol=1e-12)
    np.testing.assert_allclose(up, up[::-1, ::-1], atol=1e-12)


@pytest.mark.parametrize(("sigma_x", "sigma_y"), [(6.0, 1.0), (1.0, 6.0)])
def test_each_side_of_a_frame_is_extended_by_its_own_radius(sigma_x: float, sigma_y: float) -> None:
    """Once where zeros wrap around, on both sides where the frame is reflected, there by less than the frame itself."""
    psf = PointSpread(sigma_x=sigma_x, sigma_y=sigma_y)
    down, right = _extension(psf)
    assert abs(down - right) > 10
    fast = [next_fast_len(n, real=True) for n in (30 + down, 50 + right)]
    assert FourierFilter(psf, (30, 50), 1e-3).size == tuple(fast)
    reflected = FourierFilter(psf, (30, 50), 1e-3, beyond="reflect")
    assert reflected.before == (min(down, 29), min(right, 49))
    assert reflected.size == tuple(
        next_fast_len(n + 2 * b, real=True) for n, b in zip((30, 50), reflected.before, strict=True)
    )


@pytest.mark.parametrize("shape", [(5, 60), (60, 5)])
def test_a_narrow_frame_is_reflected_once_on_each_side(shape: tuple[int, int]) -> None:
    """As far as it has px; beyond lies its mean, and all of it fades into that."""
    psf = PointSpread(sigma_x=3.0, sigma_y=3.0)
    made = FourierFilter(psf, shape, 1e-3, "wiener", "reflect", dtype=torch.float64)
    frame = torch.rand((2, *shape), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    mean = frame.numpy().mean(axis=(1, 2), keepdims=True)
    after = [total - side - first for total, side, first in zip(made.size, shape, made.before, strict=True)]
    sides = [(first, min(rest, side - 1)) for first, rest, side in zip(made.before, after, shape, strict=True)]
    grown = np.pad(frame.numpy() - mean, ((0, 0), *sides), mode="reflect")
    wanted = np.pad(grown, [(0, 0), *((0, t - n) for t, n in zip(made.size, grown.shape[1:], strict=True))])
    window = _taper(made.size, made.before, *shape).numpy()
    np.testing.assert_allclose(made._reflected(frame).numpy(), wanted * window + mean, atol=1e-12)
    assert any(rest > side - 1 for rest, side in zip(after, shape, strict=True)), "one is longer than the frame"


@pytest.mark.parametrize("length", [0.1, 0.3, 2.5, 12.0])
def test_a_path_has_the_variance_of_its_line(length: float) -> None:
    """The cubic keeps it to the last digit, however few points stand for the line."""
    row = _path(length, 0.0, linear=False).sum(axis=0)
    x = np.arange(len(row)) - len(row) // 2
    assert row.sum() == pytest.approx(1.0, abs=1e-12) and row @ x == pytest.approx(0.0, abs=1e-12)
    assert row @ x**2 == pytest.approx(length**2 / 12, abs=1e-10)


def test_the_noise_is_read_where_a_blur_lets_nothing_pass() -> None:
    """The median of four silent rings; of three, the least of those that are faint; beyond half a cycle none counts."""
    f = frequencies()
    spectrum = 1.0 + np.arange(BINS) % 7
    rings = np.flatnonzero((f > 0.3) & (f <= 0.5))
    passed = np.where(f > 0.5, 0.0, 1.0)
    assert _floor(spectrum, passed, f) == 0.0
    few, enough = passed.copy(), passed.copy()
    few[rings[:3]], enough[rings[:4]] = NOISE.silent / 2, NOISE.silent / 2
    few[rings[5]] = NOISE.faint / 2
    assert _floor(spectrum, enough, f) == np.median(spectrum[rings[:4]])
    assert _floor(spectrum, few, f) == spectrum[[*rings[:3], rings[5]]].min()
    few[rings] = NOISE.faint
    assert _floor(spectrum, few, f) == 0.0


def test_where_nothing_but_noise_is_seen_the_scene_falls_with_the_square() -> None:
    """From the first ring on, and no farther than the limits."""
    f = frequencies()
    power = np.full(BINS, 1e-4)
    power[1] = 3e-4
    n = _ratio(Observed(power, 1e-4, np.ones(BINS), f))
    np.testing.assert_allclose(n[1:], np.clip(0.5 * (f[1:] / f[1]) ** 2, NOISE.least_ratio, NOISE.most_ratio))
    assert n[0] == n[1] and n[-1] == NOISE.most_ratio
    steep = _ratio(Observed((np.maximum(f, f[1]) / f[1]) ** -6.0 + 1e-6, 1e-6, np.ones(BINS), f))
    assert steep[6] / steep[3] == pytest.approx(2**NOISE.steepest)


def test_what_passes_is_the_mean_over_photos_and_directions() -> None:
    f = frequencies()
    wide = PointSpread(sigma_x=2.0, sigma_y=1.0)
    one = np.mean([wide.mtf(f, a) ** 2 for a in range(0, 1800, 225) for a in [a / 10]], axis=0)
    np.testing.assert_allclose(_passed([wide], f), one, rtol=1e-12)
    np.testing.assert_allclose(_passed([wide, None, wide], f), (2 * one + 1) / 3, rtol=1e-12)
    np.testing.assert_array_equal(_passed([None], f), 1.0)


# --- which evaluation is taken -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sigma", "taken", "wanted"),
    [
        (12.0, {"fourier": 4.0, "separable": 3.0, "reduced": 1.4}, "reduced"),
        (12.0, {"fourier": 4.0, "separable": 3.0, "reduced": 1.6}, "separable"),
        (12.0, {"fourier": 2.0, "separable": 3.0, "reduced": 1.4}, "fourier"),
        (4.0, {"fourier": 4.0, "separable": 3.0, "reduced": 0.1}, "separable"),
    ],
)
def test_the_quickest_exact_evaluation_is_taken_or_one_that_takes_half(
    sigma: float, taken: dict[str, float], wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reduced resolution is not even offered for narrow blurs."""
    offered: list[list[str]] = []
    monkeypatch.setattr(operator_module, "_seconds", lambda evaluation, frame: taken.get(evaluation.name, 99.0))
    monkeypatch.setattr(operator_module, "choice", lambda *_, names, measure: offered.append(names) or measure())
    made = BlurOperator(PointSpread(sigma_x=sigma, sigma_y=sigma), 64, 72, 3)
    assert made.evaluation == wanted and ("reduced" in offered[0]) == (sigma >= 10.0)


def test_the_best_of_three_measurements_counts_and_the_first_call_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    took, clock = iter([1.0, 3.0, 5.0, 4.0]), [0.0]
    monkeypatch.setattr(operator_module.time, "perf_counter", lambda: clock[0])

    class Slow:
        name = "slow"

        def apply(self, frame: torch.Tensor) -> torch.Tensor:
            clock[0] += next(took)
            return frame

        adjoint = staticmethod(lambda frame: frame)

    assert operator_module._seconds(Slow(), torch.zeros(3, 2, 2)) == 3.0  # type: ignore[arg-type]
    assert next(took, None) is None


# --- layers ------------------------------------------------------------------------------------------------------


def test_tents_share_every_variance_between_two_neighbours() -> None:
    variances = [0.0, 1.0, 4.0]
    assert tent_of(variances, 0) == (1.0, 0.0, 1.0, -1.0)
    assert tent_of(variances, 1) == (0.0, 1.0, 1.0 + 1 / 3, -1 / 3)
    assert tent_of(variances, 2) == (1.0 - 4 / 3, 1 / 3, 1.0, 0.0)
    for v in (0.0, 0.3, 1.0, 2.5, 4.0):
        weights = [
            max(0.0, min(r0 + r1 * v, f0 + f1 * v)) for r0, r1, f0, f1 in (tent_of(variances, k) for k in range(3))
        ]
        assert sum(weights) == pytest.approx(1.0) and np.dot(weights, variances) == pytest.approx(v)


def test_rungs_reach_to_the_width_that_is_asked_for_and_one_at_least() -> None:
    assert len(_variances(0.0)) == len(_variances(LADDER[0])) == 2 and _variances(0.0)[0] == 0.0
    assert len(_variances(LADDER[2])) == 4 and len(_variances(LADDER[2] * 0.999)) == 3
    taps = gaussian_taps(LADDER[1])
    x = np.arange(len(taps)) - len(taps) // 2
    assert _variances(LADDER[2])[2] == pytest.approx(float((taps * x**2).sum()))


def test_gradients_of_a_layer_by_the_formula_of_its_tent() -> None:
    """At the tent's top it falls already; at its foot it still has the slope of the side that it stands on."""
    random = torch.Generator().manual_seed(0)
    variance = torch.tensor([[0.0, 0.5, 1.0, 2.0, 4.0, 5.0]], dtype=torch.float64)
    light = torch.rand((3, 1, 6), generator=random, dtype=torch.float64)
    back = torch.rand((4, 1, 6), generator=random, dtype=torch.float64)
    tent = tent_of([0.0, 1.0, 4.0], 1)
    gradient, in_variance = torch.ones_like(light), torch.ones_like(variance)
    layer_gathered(back, light, variance, tent, (gradient, in_variance))
    weight = torch.tensor([0.0, 0.5, 1.0, 2 / 3, 0.0, 0.0], dtype=torch.float64)
    slope = torch.tensor([1.0, 1.0, -1 / 3, -1 / 3, -1 / 3, 0.0], dtype=torch.float64)
    torch.testing.assert_close(gradient, 1 + weight * back[:3])
    share = (back[:3] * light).sum(dim=0) - back[3]
    sure = torch.tensor([0, 1, 2, 3, 5])
    torch.testing.assert_close((in_variance - 1)[:, sure], (slope * share)[:, sure])
    weighed = layer_weighed(light, variance, tent)
    torch.testing.assert_close(weighed, torch.cat([weight * light, weight[None, None]]))


def test_a_symmetric_kernel_has_a_real_transfer_function_of_half_the_memory() -> None:
    frame, kernel = Frame(12, 14, 2), PointSpread(sigma_x=1.5, sigma_y=1.0).kernel()
    assert Fourier(kernel, frame, torch.float32, CPU).transfer.dtype == torch.float32
    assert Fourier(np.array([[0.2, 0.3, 0.5]]), frame, torch.float32, CPU).transfer.dtype == torch.complex64
