"""The Python API: arrays in, a twin out, pictures of it, and a kernel measured from an array."""

import numpy as np
import pytest
from dgs.api import DgsError, Twin, measure_psf, reconstruct
from dgs.core.camera import Camera
from dgs.tests.command_line.scene import SIGMA, write_scene
from PIL import Image


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A short run on photos that are given as arrays, with a kernel that is an array."""
    folder = tmp_path_factory.mktemp("api")
    write_scene(folder)
    files = sorted((folder / "photos").glob("*.png"))
    photos = {file.stem: np.asarray(Image.open(file)) for file in files}
    # (the cameras name the files with their suffix)
    for file in (folder / "model").glob("images.txt"):
        file.write_text(file.read_text("utf-8").replace(".png", ".tif"), "utf-8")
    x = np.arange(-9, 10)
    line = np.exp(-0.5 * (x / SIGMA) ** 2)
    kernel = np.outer(line, line) / line.sum() ** 2
    options = {"preset": "draft", "max_gaussians": 1000, "effects": "none", "background": "none"}
    twin = reconstruct(photos, folder / "out", kernel, folder / "model", options)
    return folder, photos, twin


def test_arrays_in_and_a_twin_out(made):
    folder, photos, twin = made
    assert len(twin) == len(twin.gaussians.means) > 100 and len(twin.names) == len(photos)
    assert twin.report["heldout"]["degraded"]["psnr"] > 20
    assert (folder / "out" / "report.html").is_file()
    read = np.asarray(Image.open(next((folder / "out-photos").glob("*00.tif"))))
    assert read.tobytes() == photos[sorted(photos)[0]].tobytes()


def test_a_twin_is_opened_and_drawn(made):
    folder, photos, twin = made
    again = Twin.open(folder / "out")
    assert again.gaussians.means.tobytes() == twin.gaussians.means.tobytes()
    name = again.names[3]
    blurred, sharp = again.render(name, psf=f"gaussian:{SIGMA}"), again.render(name)
    photo = photos[name.removesuffix(".tif")] / 255.0
    assert blurred.shape == photo.shape and blurred.dtype == np.float32
    assert np.sqrt(np.mean((blurred - photo) ** 2)) < 0.08 < np.sqrt(np.mean((sharp - photo) ** 2)) + 0.08
    lens, pose = again.lenses[name], again.poses[name]
    camera = Camera("any", lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, pose.rotation, pose.translation)
    assert np.abs(again.render(camera) - sharp).max() < 1e-5
    again.save(folder / "other.spz")
    assert len(Twin.open(folder / "other.spz", folder / "model")) == len(twin)
    with pytest.raises(DgsError, match="nobody"):
        again.render("nobody")


def test_what_makes_no_sense_is_refused(made):
    folder, photos, _ = made
    with pytest.raises(DgsError, match="'stepss'"):
        reconstruct(photos, folder / "wrong", options={"stepss": 3})
    with pytest.raises(DgsError, match="no photo"):
        reconstruct([np.zeros((4, 5, 2), np.uint8)], folder / "wrong")
    (folder / "mine").mkdir()
    (folder / "mine" / "twin.ply").write_text("mine")
    with pytest.raises(DgsError, match="did not write"):
        reconstruct(photos, folder / "mine")


def test_a_kernel_is_measured_from_an_array():
    y, x = np.mgrid[:65, :65] - 32.0
    spot = 0.02 + 0.9 * np.exp(-0.5 * (x**2 + y**2) / 3.0**2)
    noise = np.random.default_rng(0).normal(0, 0.002, spot.shape)
    measured = measure_psf(np.clip(spot + noise, 0, 1), linear=False)
    assert measured.kind == "point" and abs(measured.sigma - 3.0) < 0.1
    assert abs(measured.kernel.sum() - 1) < 1e-6
