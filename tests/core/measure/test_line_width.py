"""The width of a line through a known blur: drawn lines of known widths, in photos that are blurred and noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.imaging.psf import PointSpread, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.measure.line_fit import LineLikelihood, cosines_along, whitened
from dgs.core.measure.line_profiles import line_profiles
from dgs.core.measure.line_spread import line_spread, widened
from dgs.core.measure.line_width import edges_moved, width_through
from dgs.core.measure.sights import BlurOrigin, Sight
from dgs.core.training.grid import GridView
from dgs.core.views import View
from scipy.ndimage import convolve, gaussian_filter

SIZE, FINE = 96, 4
ACROSS = ((30.0, 48.0), (66.0, 48.0))
GIVEN = BlurOrigin()


def photo_of(
    width: float,
    psf: str | PointSpread = "gaussian:4",
    *,
    grain: float = 0.0,
    noise: float = 0.003,
    lean: float = 0.0,
    mix: str = "srgb",
) -> Sight:
    """A dark line on a light ground, `width` px wide about x = 48.3, that leans by `lean` px for each px.

    Args:
        grain: standard deviation of the ground's texture.
        mix: where light adds up within a px, and in the blur if that is 'linear'; 'px' only within a px.
    """
    random = np.random.default_rng(3)
    fine = (np.arange(SIZE * FINE) + 0.5) / FINE
    inside = np.abs(fine[None, :] - 48.3 - lean * (fine[:, None] - 48.0)) < width / 2
    texture = gaussian_filter(random.standard_normal((SIZE * FINE,) * 2), 2.0 * FINE)
    ground = 0.7 + grain * texture / texture.std()
    sharp = np.where(inside, 0.2, ground)
    light = sharp if mix == "srgb" else srgb_to_linear(sharp)
    light = light.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))
    seen = linear_to_srgb(light) if mix == "px" else light
    spread = parse_psf(psf) if isinstance(psf, str) else psf
    blurred = convolve(seen, spread.kernel(), mode="nearest")
    blurred = linear_to_srgb(blurred) if mix == "linear" else blurred
    blurred = blurred + noise * random.standard_normal((SIZE, SIZE))
    camera = Camera("a", SIZE, SIZE, 100.0, 100.0, SIZE / 2, SIZE / 2, np.eye(3), np.zeros(3))
    values = np.round(np.clip(blurred, 0, 1) * 65535).astype(np.uint16)
    view = GridView(View(camera, np.repeat(values[:, :, None], 3, axis=2)), camera, 1, spread, "srgb")
    empty = np.zeros((3, SIZE, SIZE), np.float32)
    return Sight(camera, np.ones((SIZE, SIZE), np.float32), empty, empty, 4.0, True, view)


def measured(sight: Sight, blur: BlurOrigin = GIVEN) -> tuple[float, float]:
    found = width_through(sight, ACROSS, blur)
    assert found is not None
    return found


#: What a dark line on this ground is corrected by in sRGB, where no px of these drawings has moved its edges.
MOVED = edges_moved(np.array([[0.7] * 3, [0.2] * 3, [0.7] * 3]))


@pytest.mark.parametrize(("width", "mix"), [(5.0, "srgb"), (5.0, "linear"), (8.0, "srgb"), (12.0, "srgb")])
def test_a_line_narrower_than_its_blur_is_as_wide_as_it_is(width: float, mix: str) -> None:
    """On an even ground, of one colour, noise alone is left."""
    found, deviation = measured(photo_of(width, mix=mix), replace(GIVEN, space=mix))
    moved = MOVED if mix == "srgb" else 0.0
    assert abs(found - moved - width) < 0.02 * width + deviation and deviation < 0.05 * width


def test_texture_beside_the_line_widens_the_interval_which_holds() -> None:
    even, grainy = (measured(photo_of(7.0, grain=grain), GIVEN) for grain in (0.0, 0.06))
    assert grainy[1] > 2.5 * even[1]
    assert abs(grainy[0] - 7.0) < 2.0 * grainy[1]


def test_points_that_were_set_askew_make_no_line_wider() -> None:
    upright, leaning = measured(photo_of(7.0)), measured(photo_of(7.0, lean=0.12))
    assert abs(leaning[0] - upright[0] / np.hypot(1.0, 0.12)) < 0.15, "across the line, not along the points"


def test_light_that_adds_up_within_a_px_is_thought_of() -> None:
    """A dark line of 8 px looks 0.2 px narrower in sRGB than it is, a light one wider."""
    assert 0.1 < MOVED < 0.3 and edges_moved(np.array([[0.2] * 3, [0.7] * 3, [0.2] * 3])) < -0.05
    found = measured(photo_of(8.0, mix="px", noise=0.001))[0]
    assert abs(found - 8.0) < 0.08 < abs(found - MOVED - 8.0)


def test_a_blur_that_is_no_gaussian_is_taken_as_it_is() -> None:
    y, x = np.mgrid[-9:10, -9:10]
    disk = point_spread_from_samples((np.hypot(x, y) <= 8.0).astype(float))
    found, deviation = measured(photo_of(6.0, disk, noise=0.001))
    assert abs(found - 6.0) < 0.25
    sight = photo_of(6.0, disk, noise=0.001)
    assert sight.view is not None
    gaussian = PointSpread(sigma_x=4.0, sigma_y=4.0)
    wrong = measured(replace(sight, view=sight.view.blurred_by(gaussian)))
    assert abs(wrong[0] - 6.0) > 2 * abs(found - 6.0), "a Gaussian as wide is another blur"


def test_an_estimated_blur_makes_narrow_lines_less_sure_and_wide_ones_hardly() -> None:
    estimated = replace(GIVEN, estimated=True)
    narrow, wide = (
        np.sqrt(measured(photo_of(width), estimated)[1] ** 2 - measured(photo_of(width))[1] ** 2)
        for width in (6.0, 14.0)
    )
    assert narrow > 0.5 and wide < 0.4 * narrow


def test_where_no_line_is_or_the_photo_ends_it_says_nothing() -> None:
    assert width_through(photo_of(0.0, grain=0.05), ACROSS, GIVEN) is None
    assert width_through(photo_of(7.0), ((2.0, 48.0), (30.0, 48.0)), GIVEN) is None
    sight = photo_of(7.0)
    assert sight.view is not None
    assert width_through(replace(sight, view=sight.view.blurred_by(None)), ACROSS, GIVEN) is None


def test_line_spread_is_the_point_spread_across_the_line() -> None:
    axes = np.array([[0.6, 0.8], [-0.8, 0.6]])
    spread = line_spread(PointSpread(sigma_x=3.0, sigma_y=5.0), axes)
    assert np.isclose(spread.across**2, 0.36 * 9 + 0.64 * 25 + 1 / 12)
    assert np.isclose(spread.along**2, 0.64 * 9 + 0.36 * 25 + 1 / 12)
    step = spread.places[1] - spread.places[0]
    assert np.isclose(spread.density.sum() * step, 1.0, atol=1e-3)
    assert np.isclose((spread.density * spread.places**2).sum() * step, spread.across**2, rtol=1e-2)
    assert np.isclose(float(spread.edge(np.array(0.0))), 0.5) and float(spread.edge(np.array(1e3))) == 1.0
    assert np.isclose(widened(spread, 2.0).across, 2 * spread.across)


def test_cosines_have_the_same_noise_and_nothing_in_common() -> None:
    waves = cosines_along(21)
    assert np.allclose(waves @ waves.T, np.eye(len(waves)) / 21)


def test_the_covariance_of_texture_is_that_of_drawn_textures() -> None:
    """Cosines along drawn patches (exp(-r / 6)), blurred and with the line cut out, scatter as the likelihood says."""
    sight = photo_of(8.0)
    seen = line_profiles(sight, ACROSS)
    assert seen is not None
    likelihood = LineLikelihood(seen.places, seen.block, seen.spread)
    random, size = np.random.default_rng(1), 160
    frequency = np.hypot(*np.meshgrid(*(2 * np.pi * np.fft.fftfreq(size),) * 2))
    spectrum = (frequency**2 + 6.0**-2) ** -1.5  # of exp(-r / 6) in two dimensions
    power = np.sqrt(spectrum * size**2 / spectrum.sum())
    middle, reach, count = size // 2, len(seen.places) // 2, seen.block.shape[1]
    outside = np.abs(np.arange(size) - middle) > 4
    outside_share = outside + 0.5 * (np.abs(np.arange(size) - middle) == 4)
    drawn = []
    for _ in range(300):
        texture = np.fft.ifft2(np.fft.fft2(random.standard_normal((size, size))) * power).real
        blurred = gaussian_filter(texture * outside_share, np.hypot(4.0, 12**-0.5), mode="wrap")
        rows = slice(middle - count // 2, middle - count // 2 + count)
        drawn.append(cosines_along(count) @ blurred[rows, middle - reach : middle + reach + 1])
    variance = np.var(drawn, axis=0)
    found = likelihood._outside(0.0, 8.0, float(np.log(6.0)))
    for k in range(3):
        said = np.diag(found[k])
        assert np.isclose(variance[k].mean(), said.mean(), rtol=0.15), k
        assert np.isclose(variance[k][reach], said[reach], rtol=0.3), "in the line's middle"


def test_rows_are_whitened_by_one_decomposition_of_all() -> None:
    random = np.random.default_rng(0)
    parts = random.standard_normal((2, 3, 5, 9))
    covariance = parts @ parts.transpose(0, 1, 3, 2)
    rows = random.standard_normal((2, 3, 2, 5))
    logs, white = whitened(covariance, rows)
    assert np.allclose(2 * logs.sum(axis=-1), np.linalg.slogdet(covariance)[1])
    assert np.allclose(
        white @ white.transpose(0, 1, 3, 2), rows @ np.linalg.inv(covariance) @ rows.transpose(0, 1, 3, 2)
    )
    with pytest.raises(np.linalg.LinAlgError):
        whitened(-covariance, rows)
