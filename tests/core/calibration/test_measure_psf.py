"""The point spread from calibration photos whose truth is known."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from dgs.core.calibration.measure import measure_psf
from dgs.core.errors import PsfError
from dgs.core.imaging.psf import point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from dgs.tests.core.calibration import calibration_photos as photos
from PIL import Image

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("sigma", [1.0, 2.0, 5.0])
def test_a_point_off_the_grid_on_a_sloping_background(tmp_path, sigma):
    errors, said = [], []
    for seed in range(6):
        place = 60 + np.random.default_rng(seed).uniform(-0.5, 0.5, 2)
        file = photos.photo(
            tmp_path / "p.tif", photos.point_light(120, place, sigma, background=(0.03, 0.03)), 0.002, 16, seed
        )
        measured = measure_psf(file)
        assert measured.kind == "point" and measured.space == "linear"
        errors.append(measured.sigma - sigma)
        said.append(measured.sigma_uncertainty)
        assert np.hypot(measured.place[0] - place[0], measured.place[1] - place[1]) < 0.02
        kernel = point_spread_from_samples(measured.kernel)
        assert not kernel.notes and np.linalg.det(kernel.covariance) ** 0.25 == pytest.approx(sigma, rel=0.02)
        assert measured.fwhm == pytest.approx(2.3548 * sigma, rel=0.02)
    assert np.abs(errors).max() < 0.01 * sigma
    # The reported uncertainty is the true one (within what six photos can say).
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) / np.mean(said) < 2.5


@pytest.mark.parametrize("slant", [5.0, -4.0, 87.0, 12.0])
@pytest.mark.parametrize("sigma", [1.0, 5.0])
def test_a_slanted_edge(tmp_path, sigma, slant):
    file = photos.photo(tmp_path / "e.tif", photos.edge_light(120, slant, sigma), 0.004)
    measured = measure_psf(file)
    assert measured.kind == "edge"
    assert measured.sigma == pytest.approx(sigma, rel=0.015)
    assert abs(measured.sigma - sigma) < 4 * measured.sigma_uncertainty + 2e-3 * sigma
    assert measured.slant == pytest.approx(abs(slant) if abs(slant) < 45 else 90 - slant, abs=0.1)
    true = np.exp(-2 * np.pi**2 * sigma**2 * measured.frequencies**2)
    assert np.abs(measured.mtf - true).max() < 0.02
    kernel = point_spread_from_samples(measured.kernel)
    assert np.linalg.det(kernel.covariance) ** 0.25 == pytest.approx(sigma, rel=0.02)


def test_eight_bits_are_enough(tmp_path):
    point = measure_psf(photos.photo(tmp_path / "p.png", photos.point_light(100, (50.2, 49.7), 3.0), 0.003, 8))
    edge = measure_psf(photos.photo(tmp_path / "e.png", photos.edge_light(100, 5.0, 3.0), 0.003, 8))
    assert point.sigma == pytest.approx(3.0, rel=0.015) and edge.sigma == pytest.approx(3.0, rel=0.015)


def test_two_widths_and_their_direction(tmp_path):
    file = photos.photo(tmp_path / "p.tif", photos.point_light(140, (70.3, 69.6), 6.0, 3.0, 30.0))
    measured = measure_psf(file)
    assert (measured.sigma_x, measured.sigma_y) == (pytest.approx(6.0, rel=0.01), pytest.approx(3.0, rel=0.01))
    assert measured.angle == pytest.approx(30.0, abs=1.0)
    assert any("one direction" in note for note in measured.notes)


def disk(size: int, place: tuple[float, float], radius: float) -> np.ndarray:
    x, y = photos._grid(size)
    return photos._pixels(0.02 + 0.6 * (np.hypot(x - place[0], y - place[1]) < radius))


def test_a_spread_that_is_no_gaussian_is_kept_and_said(tmp_path):
    light = disk(100, (50.3, 49.9), 6.0)
    measured = measure_psf(photos.photo(tmp_path / "p.tif", light), "point")
    assert any("not a Gaussian" in note for note in measured.notes)
    reach = measured.kernel.shape[0] // 2
    assert measured.kernel[reach, reach] == pytest.approx(1 / (np.pi * 36), rel=0.08)
    assert measured.fwhm == pytest.approx(12.0, rel=0.03)
    covariance = point_spread_from_samples(measured.kernel).covariance
    assert covariance[0, 0] == pytest.approx(36 / 4, rel=0.06)  # a disc's variance is r^2 / 4


def test_linear_light_is_not_the_file_s_values(tmp_path):
    file = photos.photo(tmp_path / "p.tif", photos.point_light(100, (50, 50), 4.0, background=(0.0, 0.0)), 1e-4)
    assert measure_psf(file).sigma == pytest.approx(4.0, rel=0.01)
    assert measure_psf(file, linear=False).sigma > 4.4  # the curve lifts the flanks
    straight = photos.photo(tmp_path / "l.tif", photos.point_light(100, (50, 50), 4.0), 1e-4, encode=False)
    assert measure_psf(straight, linear=False).sigma == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(
    ("light", "kind", "says"),
    [
        (np.full((64, 64), 0.2), "auto", "stands out"),
        (np.full((64, 64), 0.2), "point", "stands out"),
        (np.full((64, 64), 0.2), "edge", "stands out"),
        (photos.point_light(64, (32, 32), 3.0, amplitude=1.5), "auto", "saturated"),
        (photos.point_light(64, (8, 32), 4.0), "point", "border"),
        (photos.edge_light(96, 0.0, 1.0, offset=0.2), "auto", "not slanted"),
        (photos.edge_light(96, 45.0, 1.0, offset=0.2), "auto", "not slanted"),
        (photos.edge_light(96, 5.0, 2.0, high=1.4), "auto", "saturated"),
        (np.full((8, 8), 0.2), "auto", "too small"),
    ],
)
def test_what_cannot_be_measured_says_the_way_out(tmp_path, light, kind, says):
    with pytest.raises(PsfError, match=says) as caught:
        measure_psf(photos.photo(tmp_path / "photo.tif", light, 0.001), kind)
    assert caught.value.way_out and "photo.tif" in caught.value.what


def test_the_command_writes_a_kernel_that_reconstruct_takes(tmp_path):
    file = photos.photo(tmp_path / "point.png", photos.point_light(100, (50.2, 49.7), 3.0), 0.002, 8)
    out = tmp_path / "kernel.tif"
    call = [sys.executable, str(ROOT / "run_dgs.py"), "measure-psf", str(file), "--out", str(out)]
    run = subprocess.run([*call, "--json"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    figures = json.loads(run.stdout)
    assert figures["sigma"] == pytest.approx(3.0, rel=0.02) and figures["space"] == "linear"
    for text in (str(out), f"file:{out}"):
        psf = parse_psf(text)
        assert psf is not None and np.sqrt(psf.covariance[0, 0]) == pytest.approx(3.0, rel=0.02)
    assert Image.open(figures["picture"]).size[0] > 600
    plain = subprocess.run(call, capture_output=True, text=True, check=False)
    assert "sigma px" in plain.stdout and "linear" in plain.stdout
    bad = subprocess.run([*call[:-1], str(tmp_path / "kernel.jpg")], capture_output=True, text=True, check=False)
    assert bad.returncode == 2 and "ends in .tif" in bad.stderr
