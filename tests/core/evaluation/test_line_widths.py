"""Widths of analytic lines: known edges, blurs, noise and sub-pixel shifts."""

import json

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.errors import FormatError
from dgs.core.evaluation.edges import fit_edge, fit_width
from dgs.core.evaluation.lines import (
    PaintedLine,
    concordance,
    contrast_direction,
    line_width,
    read_lines,
    station_profile,
    stations,
)
from dgs.core.evaluation.profiles import Sampler, intensity_profile
from scipy.optimize import brentq
from scipy.special import ndtr

X = np.arange(-20.0, 20.01, 0.5)


def blurred_line(x, width, sigma, shift=0.0):
    """A line of value 1 and the given width, convolved with a Gaussian."""
    return ndtr((x - shift + width / 2) / sigma) - ndtr((x - shift - width / 2) / sigma)


@pytest.mark.parametrize("sigma", [0.4, 1.0, 2.5])
@pytest.mark.parametrize("shift", [-0.37, 0.0, 0.21, 0.5])
def test_an_edge_is_found_to_a_hundredth_of_a_pixel(sigma, shift):
    edge = fit_edge(X, 0.2 + 0.5 * ndtr((X - shift) / sigma))
    assert edge is not None
    assert edge.position == pytest.approx(shift, abs=0.01)
    assert edge.blur == pytest.approx(sigma, abs=0.02)
    assert (edge.outside, edge.inside) == (pytest.approx(0.2, abs=2e-3), pytest.approx(0.7, abs=2e-3))


@pytest.mark.parametrize("width", [8.4, 13.5])
@pytest.mark.parametrize("shift", [-0.4, 0.0, 0.3])
@pytest.mark.parametrize("dark", [False, True])
def test_a_resolved_line_has_its_own_width(width, shift, dark):
    values = blurred_line(X, width, 0.8, shift)
    found = fit_width(X, 0.9 - 0.4 * values if dark else 0.1 + 0.4 * values)
    assert found is not None
    assert found.value == pytest.approx(width, abs=0.02)
    assert found.blur == pytest.approx(0.8, abs=0.05)


@pytest.mark.parametrize("width", [4.0, 8.4, 13.5])
def test_a_blurred_line_reads_as_wide_as_it_looks(width):
    """Nothing is deconvolved: the width is near the full width at half of the line's own peak."""
    x = np.arange(-25.0, 25.01, 0.5)
    half = blurred_line(0.0, width, 5.0) / 2
    visible = 2 * brentq(lambda at: blurred_line(at, width, 5.0) - half, 0.0, 30.0)
    found = fit_width(x, blurred_line(x, width, 5.0))
    assert found is not None
    assert found.value == pytest.approx(visible, rel=0.06)
    assert found.value > width + 0.5


def test_the_uncertainty_is_the_scatter_of_noisy_edges():
    generator = np.random.default_rng(3)
    clean = blurred_line(X, 10.0, 1.0, 0.2)
    found = [fit_width(X, clean + generator.normal(0.0, 0.03, X.shape)) for _ in range(200)]
    values = np.array([one.value for one in found if one is not None])
    reported = np.median([one.uncertainty for one in found if one is not None])
    assert len(values) == 200
    assert values.mean() == pytest.approx(10.0, abs=0.02)
    assert 0.6 < reported / values.std() < 1.6


def test_no_edge_where_there_is_none():
    generator = np.random.default_rng(1)
    assert fit_edge(X, np.full(X.shape, 0.3)) is None
    assert sum(fit_width(X, generator.normal(0.5, 0.05, X.shape)) is not None for _ in range(20)) <= 2
    assert fit_edge(X[:4], X[:4]) is None
    with pytest.raises(ValueError, match="differ"):
        fit_edge(X, X[:-1])


def test_profiles_run_between_pixel_centres():
    columns = np.arange(40.0)
    image = np.repeat((columns[None] + 0.5), 30, axis=0)[..., None] * [1.0, 2.0, 3.0]
    distances, values = intensity_profile(Sampler.of(image), (8.0, 15.0), (30.0, 15.0), 0.25, breadth=4)
    assert np.allclose(values, (8.0 + distances)[:, None] * [1.0, 2.0, 3.0], atol=1e-6)
    with pytest.raises(ValueError, match="different"):
        intensity_profile(Sampler.of(image), (8.0, 15.0), (8.0, 15.0))


def camera() -> Camera:
    return Camera("view.png", 200, 150, 400.0, 400.0, 100.0, 75.0, np.eye(3), np.zeros(3))


def slanted(width_px=10.0, angle=0.3) -> PaintedLine:
    """A straight line in the plane z = 4, where a unit is 100 px."""
    along, across = np.array([-np.sin(angle), np.cos(angle), 0.0]), np.array([np.cos(angle), np.sin(angle), 0.0])
    points = np.array([0.0, 0.0, 4.0]) + np.linspace(-0.9, 0.9, 40)[:, None] * along
    return PaintedLine("red", width_px / 100, points, np.tile(across, (40, 1)), np.tile([0, 0, -1.0], (40, 1)))


def picture(width_px=10.0, sigma=0.6, angle=0.3, shift=0.0, noise=0.0) -> np.ndarray:
    """What `camera` sees of `slanted`: red on grey, anti-aliased by `sigma`."""
    y, x = np.mgrid[:150, :200] + 0.5
    across = (x - 100) * np.cos(angle) + (y - 75) * np.sin(angle)
    share = blurred_line(across, width_px, sigma, shift)[..., None]
    image = np.array([0.5, 0.5, 0.5]) * (1 - share) + np.array([0.8, 0.1, 0.1]) * share
    return image + np.random.default_rng(0).normal(0.0, noise, image.shape)


@pytest.mark.parametrize("shift", [0.0, 0.3, -1.4])
def test_a_projected_line_is_measured_in_a_picture(shift):
    places = stations(slanted(), camera())
    assert len(places) > 5
    assert all(place.width == pytest.approx(10.0, abs=1e-6) for place in places)
    truth = Sampler.of(picture())
    direction = contrast_direction(truth, places)
    exact = line_width(truth, places, direction)
    assert exact.value == pytest.approx(10.0, abs=0.03)
    other = line_width(Sampler.of(picture(11.5, 1.5, shift=shift, noise=0.01)), places, direction)
    assert other.value == pytest.approx(11.5, abs=max(0.1, 4 * other.uncertainty))
    assert 0 < other.uncertainty < 0.15
    assert other.blur == pytest.approx(1.5, abs=0.2)


def test_a_profile_is_the_difference_of_colours():
    places = stations(slanted(), camera())
    truth = Sampler.of(picture())
    positions, values = station_profile(truth, places[0], contrast_direction(truth, places))
    contrast = np.linalg.norm(np.array([0.8, 0.1, 0.1]) - 0.5)
    assert np.ptp(values) == pytest.approx(contrast, rel=0.05)
    assert positions[0] == pytest.approx(-positions[-1], abs=0.4)


def test_stations_are_seen_and_clear_of_other_lines():
    line = slanted()
    away = PaintedLine("back", line.width, line.points, line.across, -line.normals)
    crossing = slanted(angle=0.3 + np.pi / 2)
    assert stations(away, camera()) == []
    few = stations(line, camera(), [line, crossing])
    assert few
    assert all(np.linalg.norm(place.middle - [100, 75]) > 15 for place in few)


def test_a_line_that_is_not_there_has_no_width():
    places = stations(slanted(), camera())
    truth = Sampler.of(picture())
    nothing = line_width(Sampler.of(np.full((150, 200, 3), 0.5)), places, contrast_direction(truth, places))
    assert np.isnan(nothing.value) and nothing.stations == 0


def test_concordance_is_as_defined():
    assert concordance([10.0, 10.0], [10.38, 9.62]) == pytest.approx(26.3, abs=0.1)
    assert concordance([10.0, 20.0], [12.5, 25.0]) == pytest.approx(4.0)
    assert concordance([10.0], [float("nan")]) == pytest.approx(1.0)
    assert np.isnan(concordance([float("nan")], [3.0]))


def test_lines_are_read_back(tmp_path):
    entry = {
        "name": "red",
        "width_m": 0.007,
        "points": [[0, 0, 1]] * 2,
        "across": [[1, 0, 0]] * 2,
        "normals": [[0, 0, -1]] * 2,
    }
    file = tmp_path / "lines.json"
    file.write_text(json.dumps([entry]))
    (line,) = read_lines(file)
    assert (line.name, line.width, line.points.shape) == ("red", 0.007, (2, 3))
    file.write_text("[{}]")
    with pytest.raises(FormatError, match=r"lines\.json"):
        read_lines(file)
