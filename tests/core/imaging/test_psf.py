"""Point spread functions: parsing, files, normalisation, centring, coarser grids."""

from pathlib import Path

import numpy as np
import pytest
from dgs.core.errors import PsfError
from dgs.core.imaging.psf import PointSpread, gaussian_taps, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf


def moments(kernel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = kernel.shape
    y, x = np.mgrid[-(rows // 2) : rows // 2 + 1, -(columns // 2) : columns // 2 + 1]
    centroid = np.array([(kernel * x).sum(), (kernel * y).sum()])
    dx, dy = x - centroid[0], y - centroid[1]
    xy = (kernel * dx * dy).sum()
    return centroid, np.array([[(kernel * dx * dx).sum(), xy], [xy, (kernel * dy * dy).sum()]])


def blob(rows: int, columns: int, cx: float, cy: float, sigma: float) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    return np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * sigma**2))


def test_texts():
    assert parse_psf("none") is None
    psf = parse_psf("gaussian:5")
    assert psf is not None and psf.sigma_x == psf.sigma_y == 5.0 and psf.source == "gaussian:5"
    tilted = parse_psf("gaussian:5,2,30")
    assert tilted is not None and (tilted.sigma_x, tilted.sigma_y, tilted.angle) == (5.0, 2.0, 30.0)
    two = parse_psf("gaussian:5,2")
    assert two is not None and (two.sigma_x, two.sigma_y, two.angle) == (5.0, 2.0, 0.0)


@pytest.mark.parametrize(
    "text", ["", "gauss:5", "gaussian:", "gaussian:-1", "gaussian:nan", "gaussian:1,2,3,4", "none:3", "file:", "5"]
)
def test_nonsense_is_explained(text):
    with pytest.raises(PsfError) as caught:
        parse_psf(text)
    assert caught.value.way_out


@pytest.mark.parametrize("sigma", [0.0, 1e-200, 1e-3, 0.5, 5.0, 20.0])
def test_gaussian_sums_to_one_and_is_finite(sigma):
    kernel = PointSpread(sigma_x=sigma, sigma_y=sigma).kernel()
    assert np.isfinite(kernel).all() and abs(kernel.sum() - 1) < 1e-12
    assert kernel.shape[0] // 2 >= 4 * sigma
    if sigma <= 1e-3:
        assert kernel.max() == 1.0
    if sigma >= 1:
        assert moments(kernel)[1][0, 0] == pytest.approx(sigma**2, rel=2e-3)


def test_tilted_covariance_matches_the_samples():
    psf = parse_psf("gaussian:6,2,30")
    assert psf is not None and psf.separable() is None
    centroid, covariance = moments(psf.kernel())
    assert np.abs(centroid).max() < 1e-9
    assert np.allclose(covariance, psf.covariance, atol=0.06)
    assert psf.covariance[0, 1] > 0  # x and y grow together: clockwise where y is down


def test_quarter_turn_is_separable():
    turned, straight = parse_psf("gaussian:5,2,90"), parse_psf("gaussian:2,5,0")
    assert turned is not None and straight is not None
    assert np.allclose(turned.kernel(), straight.kernel(), atol=1e-15)


def test_even_and_off_centre_kernels_are_centred():
    for shape in ((24, 24), (25, 24), (25, 31)):
        values = blob(*shape, shape[1] / 2 + 0.8, shape[0] / 2 - 1.3, 2.0)
        psf = point_spread_from_samples(7 * values)
        kernel = psf.kernel()
        centroid, covariance = moments(kernel)
        assert kernel.shape[0] % 2 == kernel.shape[1] % 2 == 1
        assert np.abs(centroid).max() < 1e-5 and kernel.min() >= 0
        assert np.allclose(covariance, 4 * np.eye(2), atol=0.1)
        assert any("sum" in note for note in psf.notes) and any("moved" in note for note in psf.notes)


def test_two_by_two_point_keeps_its_centre():
    kernel = point_spread_from_samples(np.full((2, 2), 0.25)).kernel()
    assert np.abs(moments(kernel)[0]).max() < 1e-9 and kernel.min() >= 0


def test_a_good_kernel_is_left_alone():
    kernel = PointSpread(sigma_x=3.0, sigma_y=3.0).kernel()
    psf = point_spread_from_samples(kernel)
    assert psf.notes == () and psf.separable() is not None
    assert np.abs(moments(psf.kernel())[1] - moments(kernel)[1]).max() < 1e-2


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((5, 5)),
        np.full((5, 5), np.nan),
        -np.ones((5, 5)),
        np.ones(5),
        np.ones((3, 3, 3)),
        np.ones((1100, 3)),
        blob(41, 41, 2, 20, 1.0),
    ],
    ids=["dark", "nan", "negative", "line", "cube", "large", "far off"],
)
def test_senseless_kernels_are_refused(values):
    with pytest.raises(PsfError):
        point_spread_from_samples(values, "it")


def _fits(values: np.ndarray, bitpix: int, scale: float = 1.0, zero: float = 0.0) -> bytes:
    cards = [
        ("SIMPLE", "T"),
        ("BITPIX", bitpix),
        ("NAXIS", 2),
        ("NAXIS1", values.shape[1]),
        ("NAXIS2", values.shape[0]),
        ("BSCALE", scale),
        ("BZERO", zero),
    ]
    header = "".join(f"{k:<8}= {v!s:>20} / comment".ljust(80) for k, v in cards) + "END".ljust(80)
    data = values.tobytes()
    return header.ljust(2880).encode() + data + bytes(-len(data) % 2880)


def write_kernel(path: Path, values: np.ndarray) -> None:
    """`values` in [0, 1]."""
    steps = np.round(values * 65535)
    if path.suffix == ".npy":
        np.save(path, values.astype(np.float32))
    elif path.suffix == ".tiff":
        import tifffile

        tifffile.imwrite(path, values.astype(np.float32))
    elif path.suffix == ".png":
        from PIL import Image

        Image.fromarray(steps.astype(np.uint16)).save(path)
    elif path.stem.startswith("integer"):
        path.write_bytes(_fits((steps - 32768).astype(">i2"), 16, zero=32768.0))
    else:
        path.write_bytes(_fits(values.astype(">f4"), -32))


@pytest.mark.parametrize("name", ["k.npy", "k.tiff", "k.png", "k.fits", "integer.fits"])
def test_kernel_files_agree(tmp_path, name):
    values = blob(21, 25, 12, 10, 2.0) * (1 + 0.2 * np.sign(np.arange(25) - 12))
    values /= values.max()
    write_kernel(tmp_path / name, values)
    psf = parse_psf(f"file:{tmp_path / name}")
    assert psf is not None
    expected = point_spread_from_samples(values).kernel()
    size = max(*psf.kernel().shape, *expected.shape)
    ours, theirs = (np.pad(k, [((size - n) // 2,) * 2 for n in k.shape]) for k in (psf.kernel(), expected))
    assert np.abs(ours - theirs).max() < 4e-6


def test_file_failures_are_explained(tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no picture")
    (tmp_path / "broken.fits").write_bytes(b"no fits" * 100)
    (tmp_path / "short.fits").write_bytes(_fits(np.ones((9, 9), ">f4"), -32)[:2900])
    (tmp_path / "k.txt").write_text("1")
    np.save(tmp_path / "objects.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    for name in ("missing.npy", "broken.png", "broken.fits", "short.fits", "k.txt", "objects.npy"):
        with pytest.raises(PsfError, match=name):
            parse_psf(f"file:{tmp_path / name}")


def test_eight_bit_colour_png(tmp_path):
    from PIL import Image

    grey = np.round(255 * blob(9, 9, 4, 4, 1.0)).astype(np.uint8)
    Image.fromarray(np.stack([grey] * 3, axis=2)).save(tmp_path / "grey.png")
    assert parse_psf(f"file:{tmp_path / 'grey.png'}") is not None
    Image.fromarray(np.stack([grey, grey // 2, grey], axis=2)).save(tmp_path / "red.png")
    with pytest.raises(PsfError, match="coloured"):
        parse_psf(f"file:{tmp_path / 'red.png'}")


@pytest.mark.parametrize("s", [2.0, 3.0, 2.5])
def test_coarser_grid_adds_the_area_average(s):
    gaussian = PointSpread(sigma_x=5.0, sigma_y=5.0)
    sampled = point_spread_from_samples(gaussian.kernel())
    expected = (25.0 + (s * s - 1) / 12) / s**2
    for psf in (gaussian, sampled):
        kernel = psf.on_grid(s).kernel()
        assert abs(kernel.sum() - 1) < 1e-9
        assert moments(kernel)[1][0, 0] == pytest.approx(expected, rel=4e-3)
    assert gaussian.on_grid(1.0) is gaussian
    assert gaussian.kernel(s).shape[0] < gaussian.kernel().shape[0]
    lean = gaussian.on_grid(s, low_pass=0.3)
    assert lean.sigma_x**2 == pytest.approx((25.0 + (s * s - 1) * (1 / 12 - 0.3)) / s**2)


def test_downsampled_blurred_photo_is_the_coarse_blur():
    """The law itself: blur then area-average, against point samples then the coarse PSF."""
    n, s = 240, 2
    x = np.arange(n) + 0.5
    scene = 0.5 + 0.5 * np.sin(2 * np.pi * x / 40)
    photo = np.convolve(scene, gaussian_taps(3.0), mode="same").reshape(-1, s).mean(axis=1)
    coarse = 0.5 + 0.5 * np.sin(2 * np.pi * (np.arange(n // s) + 0.5) * s / 40)
    ours = np.convolve(coarse, gaussian_taps(PointSpread(sigma_x=3.0, sigma_y=3.0).on_grid(s).sigma_x), mode="same")
    wrong = np.convolve(coarse, gaussian_taps(3.0 / s), mode="same")
    inside = slice(20, -20)
    assert np.abs(ours - photo)[inside].max() < 2e-4 < np.abs(wrong - photo)[inside].max()


def test_contrast_and_resolvable_period():
    psf = PointSpread(sigma_x=5.0, sigma_y=5.0)
    assert np.allclose(psf.mtf([0.05, 0.10]), [0.291, 0.0072], atol=1e-3)
    sampled = point_spread_from_samples(psf.kernel())
    assert np.allclose(sampled.mtf([0.0, 0.05, 0.10]), psf.mtf([0.0, 0.05, 0.10]), atol=5e-4)
    assert 8.5 < psf.resolvable_period(0.0025) < 10.0
    assert PointSpread().resolvable_period(0.01) == 2.0
